//! Groups of subcommands in `--help` and in completions.

use std::fmt::Write;

use clap::Command;

/// Command whose help lists the subcommands in groups. `titles` has the group of each subcommand, in order of
/// declaration.
pub(crate) fn grouped(command: Command, titles: &[&str]) -> Command {
    let [heading, literal] = [command.get_styles().get_header(), command.get_styles().get_literal()];
    let names = command.get_subcommands().map(|subcommand| subcommand.get_name().len());
    let width = names.max().unwrap_or_default();
    let mut list = String::new();
    for (index, (subcommand, title)) in command.get_subcommands().zip(titles).enumerate() {
        if index == 0 || titles[index - 1] != *title {
            let _ = writeln!(list, "{heading}{title}:{heading:#}");
        }
        let (name, about) = (
            subcommand.get_name(),
            subcommand.get_about().cloned().unwrap_or_default(),
        );
        let _ = writeln!(list, "  {literal}{name:<width$}{literal:#}  {about}");
        if titles.get(index + 1) != Some(title) {
            list.push('\n');
        }
    }
    // clap has one heading for all subcommands; otherwise this is its usual template.
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}{heading}Options:{heading:#}\n{{options}}{{after-help}}"
    );
    command.help_template(template)
}

/// Command whose subcommands are described with their group, as lists of completions have no headings.
pub(crate) fn prefixed(command: Command, titles: &[&str]) -> Command {
    let mut titles = titles.iter();
    command.mut_subcommands(|subcommand| {
        let about = subcommand.get_about().cloned().unwrap_or_default();
        let title = titles.next().copied().unwrap_or_default();
        subcommand.about(format!("{title}: {about}"))
    })
}
