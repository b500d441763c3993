//! Parts that shaders share. A shader says in a line `#import NAME` that it needs `shaders/common/NAME.wgsl`.

macro_rules! parts {
    ($($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../../shaders/common/", $name, ".wgsl")))),*]
    };
}

/// Name and WGSL source of each part.
const PARTS: &[(&str, &str)] =
    parts! { "decaying_sum" "hash" "label_row" "power" "prefix_sum" "scatterer" "texture" "voxels" };

/// WGSL source of a shader behind the parts that it imports, and that these import, each once. An import of no known
/// name stays in the source, where it is an error of compilation.
pub(super) fn with_imports(shader: &str) -> String {
    let mut source = String::new();
    append(shader, &mut Vec::new(), &mut source);
    source
}

fn append(shader: &str, imported: &mut Vec<&'static str>, source: &mut String) {
    let mut without_imports = String::with_capacity(shader.len());
    for line in shader.lines() {
        let part = line
            .strip_prefix("#import ")
            .and_then(|name| PARTS.iter().find(|(known, _)| *known == name));
        match part {
            Some((name, _)) if imported.contains(name) => {}
            Some((name, part)) => {
                imported.push(name);
                append(part, imported, source);
            }
            None => {
                without_imports.push_str(line);
                without_imports.push('\n');
            }
        }
    }
    source.push_str(&without_imports);
}

#[test]
fn a_part_that_two_others_need_is_there_once_and_before_them() {
    let source = with_imports("#import scatterer\n#import hash\nfn f() {}\n#import nothing\n");
    assert_eq!(source.matches("fn pcg3d(").count(), 1);
    assert!(source.find("fn pcg3d(") < source.find("fn scatterer("));
    assert!(source.ends_with("fn f() {}\n#import nothing\n"));
}
