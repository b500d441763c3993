//! Commands that the docs, the sources and the help show parse, and lists of commands are complete.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser};
use insonify_testing::pages::{Page, invocations, pages, sources, texts};

use super::Cli;

/// Error of the arguments of a command line, if there is one.
fn fault(words: &[String]) -> Option<clap::Error> {
    let error = Cli::try_parse_from(words).err()?;
    (error.kind() != ErrorKind::DisplayHelp).then_some(error)
}

/// A command mentioned in a sentence may lack arguments and have a name in capitals in the place of one.
fn excused(error: &clap::Error) -> bool {
    use ErrorKind::{DisplayHelpOnMissingArgumentOrSubcommand, MissingRequiredArgument, MissingSubcommand};
    if matches!(
        error.kind(),
        DisplayHelpOnMissingArgumentOrSubcommand | MissingRequiredArgument | MissingSubcommand
    ) {
        return true;
    }
    [ContextKind::InvalidValue, ContextKind::InvalidSubcommand]
        .iter()
        .any(|kind| match error.get(*kind) {
            Some(ContextValue::String(text)) => text.chars().all(|letter| letter.is_ascii_uppercase()),
            _ => false,
        })
}

#[test]
fn commands_of_the_docs_parse() {
    let mut faults = Vec::new();
    for page in pages() {
        for (line, command) in page.commands() {
            for words in invocations(&command) {
                faults.extend(fault(&words).map(|error| format!("{}:{line}: {command}\n{error}", page.name)));
            }
        }
    }
    for page in pages().into_iter().chain(sources()) {
        for (line, span) in page.spans() {
            // Messages are formatted.
            for words in invocations(&span).iter().filter(|_| !span.contains('{')) {
                let error = fault(words).filter(|error| !excused(error));
                faults.extend(error.map(|error| format!("{}:{line}: {span}\n{error}", page.name)));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn lists_of_commands_are_complete() {
    fn check(command: &clap::Command, texts: &[Page], faults: &mut Vec<String>) {
        let names: Vec<String> = command
            .get_subcommands()
            .map(|command| command.get_name().to_owned())
            .collect();
        faults.extend(texts.iter().flat_map(|page| page.incomplete(&names)));
        command
            .get_subcommands()
            .for_each(|command| check(command, texts, faults));
    }
    let mut faults = Vec::new();
    check(&Cli::command(), &texts(), &mut faults);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn commands_of_the_help_parse() {
    fn check(command: &clap::Command, faults: &mut Vec<String>) {
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for line in help.lines().filter_map(|line| line.strip_prefix("  insonify ")) {
            let example = format!("insonify {}", line.split("  ").next().unwrap_or(line));
            for words in invocations(&example) {
                faults.extend(fault(&words).map(|error| format!("{}: {example}\n{error}", command.get_name())));
            }
        }
        command.get_subcommands().for_each(|command| check(command, faults));
    }
    let mut faults = Vec::new();
    check(&Cli::command(), &mut faults);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
