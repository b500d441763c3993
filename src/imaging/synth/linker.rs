//! Linking of fused passes into one shader, for several frames at a time.
//!
//! Each pass is a shader of its own ([`Pass`](crate::effects::pass::Pass)). Of each, what its entry point reaches is
//! taken over; declarations that are the same in several passes are taken over once. Binding 0 has a block for each
//! frame with the parameters of all passes, and bindings 1, 2, ... the buffers. Buffers that passes write hold
//! consecutive copies, one per frame; indices into them are offset accordingly.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use crate::effects::buffers::Buffer;
use crate::effects::pass::{Grid, ParamBlock};
use crate::fusion::{Bound, Fused, MAX_BUFFERS, depend_along_scanline};
use insonify_gpu::Access;

/// Name of the entry point of a linked shader.
pub const ENTRY: &str = "fused";

/// A linked shader.
pub struct Linked {
    /// WGSL source.
    pub source: String,
    /// Number of its passes.
    pub passes: usize,
    /// Buffers at bindings 1, 2, ...
    pub buffers: Vec<BoundBuffer>,
}

/// A buffer of a linked shader.
pub struct BoundBuffer {
    /// The buffer.
    pub buffer: &'static Buffer,
    /// Widest access of the passes.
    pub access: Access,
    /// Size of an element of its array in the shader, bytes.
    pub element: u32,
    /// Type of the array.
    element_type: String,
}

/// Bytes of the block of a frame: the parameters of each pass, its extent, and the stride between the frames of each
/// buffer.
pub fn block_bytes(passes: usize) -> usize {
    (passes * (ParamBlock::CAPACITY + 16) + 4 * MAX_BUFFERS).next_multiple_of(ParamBlock::CAPACITY)
}

/// Whether each frame of a submission has its own part of a buffer, one behind the other.
pub(crate) fn has_copy_per_frame(buffer: &Buffer) -> bool {
    buffer.contents.is_none() && !buffer.is_packed
}

/// Joins the passes of a dispatch.
pub fn link(passes: &[Bound], fused: &Fused) -> Linked {
    let mut linker = Linker::default();
    let mut calls: Vec<Call> = Vec::new();
    for sequence in fused {
        // Passes since the last barrier, by their place.
        let mut unordered: Vec<(usize, usize)> = Vec::new();
        for &number in &sequence.passes {
            let source = passes[number].pass.source();
            let items = items(&source);
            let position = calls.len();
            let mut call = linker.entry(&mut Unit {
                position,
                bound: &passes[number],
                items: &items,
                done: BTreeMap::new(),
            });
            // Passes by workgroup share workgroup memory, too.
            call.after_barrier = sequence.by_line
                && unordered.iter().any(|&(before, other)| {
                    !(call.by_invocation || calls[before].by_invocation)
                        || depend_along_scanline(&passes[other], &passes[number])
                });
            if call.after_barrier {
                unordered.clear();
            }
            unordered.push((position, number));
            calls.push(call);
        }
    }
    linker.finish(fused, &calls)
}

/// How the entry point of a pass is called.
struct Call {
    name: String,
    parameters: String,
    /// Size of its workgroup.
    size: u32,
    /// Whether it takes `global_invocation_id` (an element for each invocation) rather than `workgroup_id`.
    by_invocation: bool,
    /// Whether a barrier stands before it.
    after_barrier: bool,
}

/// A declaration of a module.
struct Item<'a> {
    name: &'a str,
    /// Its tokens, without attributes.
    tokens: Vec<&'a str>,
    binding: Option<usize>,
    size: Option<u32>,
    by_invocation: bool,
}

struct Unit<'a> {
    position: usize,
    bound: &'a Bound,
    items: &'a [Item<'a>],
    done: BTreeMap<&'a str, Name>,
}

#[derive(Clone)]
enum Name {
    /// Another name.
    Plain(String),
    /// A buffer, indexed from the frame on if passes write it.
    Buffer(String, bool),
}

#[derive(Default)]
struct Linker {
    declared: String,
    /// Names by declaration.
    known: BTreeMap<String, String>,
    used: BTreeSet<String>,
    buffers: Vec<BoundBuffer>,
}

/// Stands for the own name of a declaration.
const SELF: &str = "\u{1}";

impl Linker {
    /// Takes over the entry point of a pass, and its parameters.
    fn entry(&mut self, unit: &mut Unit) -> Call {
        let pass = unit.bound.pass;
        let parameters = unit.items.iter().find(|item| item.binding == Some(0));
        let parameters = parameters.map(|item| after_colon(&item.tokens)).unwrap_or_default();
        let parameters = self.rewritten(unit, &parameters, None);
        let entry = unit.items.iter().find(|item| item.name == pass.entry);
        let Name::Plain(name) = self.resolve(unit, pass.entry) else {
            unreachable!("a function is no buffer")
        };
        Call {
            name,
            parameters,
            size: entry.and_then(|entry| entry.size).unwrap_or(64),
            by_invocation: entry.is_some_and(|entry| entry.by_invocation),
            after_barrier: false,
        }
    }

    fn resolve<'a>(&mut self, unit: &mut Unit<'a>, name: &'a str) -> Name {
        if let Some(done) = unit.done.get(name) {
            return done.clone();
        }
        let Some(item) = unit.items.iter().find(|item| item.name == name) else {
            return Name::Plain(name.to_owned());
        };
        let resolved = match item.binding {
            Some(0) => Name::Plain(format!("batch_blocks[batch_frame].p{}", unit.position)),
            Some(binding) => {
                let (buffer, how) = unit.bound.buffers[binding - 1];
                let element_type = self.rewritten(unit, &after_colon(&item.tokens), None);
                let access = if how.writes() { Access::Write } else { Access::Read };
                self.bind(buffer, access, element_type)
            }
            None => Name::Plain(self.declare(unit, item)),
        };
        unit.done.insert(name, resolved.clone());
        resolved
    }

    fn bind(&mut self, buffer: &'static Buffer, access: Access, element_type: String) -> Name {
        let name = format!("buffer_{}", buffer.name);
        match self.buffers.iter_mut().find(|known| known.buffer == buffer) {
            Some(known) => {
                debug_assert_eq!(known.element_type, element_type, "{buffer:?}");
                if access == Access::Write {
                    known.access = access;
                }
            }
            None => {
                let element = match element_type.split(['<', '>']).nth(1) {
                    Some("vec4") => 16,
                    Some("vec2") => 8,
                    Some("f32" | "u32" | "atomic") => 4,
                    _ => buffer.element as u32,
                };
                self.buffers.push(BoundBuffer {
                    buffer,
                    access,
                    element,
                    element_type,
                });
            }
        }
        Name::Buffer(name, has_copy_per_frame(buffer))
    }

    fn declare<'a>(&mut self, unit: &mut Unit<'a>, item: &Item<'a>) -> String {
        let text = self.rewritten(unit, &item.tokens, Some(item.name));
        if let Some(known) = self.known.get(&text) {
            return known.clone();
        }
        let mut name = item.name.to_owned();
        while !self.used.insert(name.clone()) {
            name = format!("{}_{}", item.name, self.used.len());
        }
        let _ = writeln!(self.declared, "{}\n", text.replace(SELF, &name));
        self.known.insert(text, name.clone());
        name
    }

    /// Tokens with all names of the module resolved, and indices into buffers with a copy per frame offset to that of
    /// the frame. Of `amplitude[line * samples + i]` it makes
    /// `buffer_Amplitude[at_buffer_Amplitude + u32(line * samples + i)]`. `declared` is the name of the declaration
    /// itself, if it has one; [`SELF`] takes its place.
    fn rewritten<'a>(&mut self, unit: &mut Unit<'a>, tokens: &[&'a str], declared: Option<&str>) -> String {
        let is_struct = tokens.first() == Some(&"struct");
        let mut text = String::new();
        // A buffer just named, whose index comes next, and of each open bracket whether it holds such an index.
        let mut to_index = None;
        let mut open_brackets = Vec::new();
        let mut previous = "";
        for (index, &token) in tokens.iter().enumerate() {
            let next = tokens[index + 1..].iter().find(|token| !is_space(token));
            // Members belong to their struct: a variable of the same name is another thing.
            let is_member = previous == "." || (is_struct && next == Some(&":"));
            if is_word(token) && !is_member {
                if declared == Some(token) {
                    text.push_str(SELF);
                } else {
                    match self.resolve(unit, token) {
                        Name::Plain(name) => text.push_str(&name),
                        Name::Buffer(name, has_copies) => {
                            text.push_str(&name);
                            to_index = has_copies.then_some(name);
                        }
                    }
                }
            } else {
                debug_assert!(
                    to_index.is_none() || token == "[" || is_space(token),
                    "{to_index:?} before {token}"
                );
                text.push_str(token);
                if token == "[" {
                    open_brackets.push(to_index.is_some());
                    if let Some(name) = to_index.take() {
                        let _ = write!(text, "at_{name} + u32(");
                    }
                } else if token == "]" && open_brackets.pop() == Some(true) {
                    // Closes the `u32(` before the bracket.
                    text.insert(text.len() - 1, ')');
                }
            }
            if !is_space(token) {
                previous = token;
            }
        }
        text
    }

    fn finish(self, fused: &Fused, calls: &[Call]) -> Linked {
        let mut source = self.declared;
        let count = calls.len();
        let _ = writeln!(source, "struct Block {{");
        for (number, call) in calls.iter().enumerate() {
            let _ = writeln!(
                source,
                "    @align(16) @size({}) p{number}: {},",
                ParamBlock::CAPACITY,
                call.parameters
            );
        }
        // Padded to the size of a block on the host, where that of the next frame begins.
        let padding = block_bytes(count) - count * (ParamBlock::CAPACITY + 16);
        let _ = writeln!(source, "    extents: array<vec4<u32>, {count}>,");
        let _ = writeln!(
            source,
            "    @size({padding}) strides: array<vec4<u32>, {}>,\n}}",
            MAX_BUFFERS / 4
        );
        let _ = writeln!(source, "var<private> batch_frame: u32;");
        let _ = writeln!(
            source,
            "@group(0) @binding(0) var<storage, read> batch_blocks: array<Block>;"
        );
        let mut shifts = String::new();
        for (index, bound) in self.buffers.iter().enumerate() {
            let (name, element_type, binding) = (bound.buffer.name, &bound.element_type, index + 1);
            let access = match bound.access {
                Access::Read => "read",
                Access::Write => "read_write",
            };
            let _ = writeln!(
                source,
                "@group(0) @binding({binding}) var<storage, {access}> buffer_{name}: {element_type};"
            );
            if has_copy_per_frame(bound.buffer) {
                let _ = writeln!(source, "var<private> at_buffer_{name}: u32;");
                let stride = format!("batch_blocks[0].strides[{}][{}]", index / 4, index % 4);
                let _ = writeln!(shifts, "    at_buffer_{name} = batch_frame * {stride};");
            }
        }
        source.push_str(&wrapper(fused, calls, &shifts));
        Linked {
            source,
            passes: count,
            buffers: self.buffers,
        }
    }
}

/// The frame comes from the workgroup, so that compilers see that all its threads have the same.
const BY_INVOCATION: &str = "@builtin(global_invocation_id) id: vec3<u32>, @builtin(workgroup_id) group: vec3<u32>";
const BY_WORKGROUP: &str = "@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) id: vec3<u32>";

/// Threads of a workgroup that has a scanline.
const THREADS: u32 = 256;

/// Largest number of scanlines along y of a dispatch, the least limit of WebGPU; further ones are along x.
const MAX_LINES: u32 = 65_535;

/// Entry point that calls those of the passes.
fn wrapper(fused: &Fused, calls: &[Call], shifts: &str) -> String {
    let mut text = String::new();
    let extent = |number: usize| format!("batch_blocks[0].extents[{number}]");
    match (&fused[..], calls) {
        ([_], [call]) => {
            let (inputs, group, thread) = if call.by_invocation {
                (BY_INVOCATION, "group", "")
            } else {
                (BY_WORKGROUP, "id", "thread, ")
            };
            let z = format!("{}.z", extent(0));
            let _ = writeln!(text, "@compute @workgroup_size({})\nfn {ENTRY}({inputs}) {{", call.size);
            let _ = writeln!(text, "    batch_frame = {group}.z / {z};\n{shifts}");
            let _ = writeln!(text, "    {}({thread}vec3<u32>(id.xy, id.z % {z}));", call.name);
        }
        ([sequence], _) if !sequence.by_line => {
            let _ = writeln!(text, "@compute @workgroup_size(64)\nfn {ENTRY}({BY_INVOCATION}) {{");
            let _ = writeln!(text, "    batch_frame = group.z;\n{shifts}");
            for (number, call) in calls.iter().enumerate() {
                let z = format!("{}.z", extent(number));
                let _ = writeln!(text, "    for (var z = 0u; z < {z}; z++) {{");
                let _ = writeln!(text, "        {}(vec3<u32>(id.xy, z));\n    }}", call.name);
            }
        }
        _ => by_lines(&mut text, fused, calls, shifts),
    }
    text.push_str("}\n");
    text
}

/// The part of the entry point for sequences that have a scanline to each workgroup.
fn by_lines(text: &mut String, fused: &Fused, calls: &[Call], shifts: &str) {
    let extent = |number: usize| format!("batch_blocks[0].extents[{number}]");
    let _ = writeln!(
        text,
        "@compute @workgroup_size({THREADS})\nfn {ENTRY}({BY_WORKGROUP}) {{"
    );
    let _ = writeln!(
        text,
        "    batch_frame = id.z;\n{shifts}    var line = id.y + {MAX_LINES}u * id.x;"
    );
    let mut number = 0;
    for sequence in fused {
        let e = extent(number);
        let lines = if sequence.by_line {
            format!("{e}.y")
        } else {
            format!("{e}.y * {e}.z")
        };
        let _ = writeln!(text, "    if line < {lines} {{");
        let end = number + sequence.passes.len();
        while number < end {
            if calls[number].after_barrier {
                let _ = writeln!(text, "        storageBarrier();\n        workgroupBarrier();");
            }
            let name = &calls[number].name;
            if !sequence.by_line {
                let e = extent(number);
                let _ = writeln!(
                    text,
                    "        {name}(thread, vec3<u32>(0u, line % {e}.y, line / {e}.y));"
                );
                number += 1;
            } else if !calls[number].by_invocation {
                let _ = writeln!(text, "        {name}(thread, vec3<u32>(0u, line, 0u));");
                number += 1;
            } else {
                // Up to the next barrier, an invocation goes through all passes at a sample.
                let run = number..end;
                let run = run.take_while(|&member| {
                    calls[member].by_invocation && (member == number || !calls[member].after_barrier)
                });
                let run: Vec<usize> = run.collect();
                let widest = run.iter().map(|&member| format!("{}.x", extent(member)));
                let widest = widest.reduce(|a, b| format!("max({a}, {b})")).unwrap_or_default();
                let _ = writeln!(
                    text,
                    "        for (var x = thread; x < 64u * {widest}; x += {THREADS}u) {{"
                );
                for &member in &run {
                    let (e, name) = (extent(member), &calls[member].name);
                    let _ = writeln!(
                        text,
                        "            for (var z = 0u; z < {e}.z; z++) {{\n                \
                         {name}(vec3<u32>(x, line, z));\n            }}"
                    );
                }
                let _ = writeln!(text, "        }}");
                number += run.len();
            }
        }
        let _ = writeln!(text, "        return;\n    }}\n    line -= {lines};");
    }
}

/// Workgroups of a dispatch for one frame, given the extents of its passes; those of the frames lie along z.
pub fn workgroups(passes: &[Bound], fused: &Fused, extents: &[[u32; 3]]) -> [u32; 3] {
    match (&fused[..], extents) {
        ([_], [extent]) => *extent,
        ([sequence], _) if !sequence.by_line => {
            let largest = |axis: usize| extents.iter().map(|extent| extent[axis]).max().unwrap_or(0);
            [largest(0), largest(1), 1]
        }
        _ => {
            let mut number = 0;
            let lines = fused.iter().map(|sequence| {
                let [_, y, z] = extents[number];
                number += sequence.passes.len();
                let shares = matches!(passes[sequence.passes[0]].pass.grid, Grid::Workgroups(_));
                if shares { y * z } else { y }
            });
            let lines: u32 = lines.sum();
            [lines.div_ceil(MAX_LINES), lines.min(MAX_LINES), 1]
        }
    }
}

fn is_word(token: &str) -> bool {
    token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
}

fn is_space(token: &str) -> bool {
    token.starts_with(char::is_whitespace)
}

/// Words, numbers, white space and single characters of a source, without comments.
fn tokens(source: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = source;
    while let Some(first) = rest.chars().next() {
        let end = |part: fn(char) -> bool| rest.find(|c| !part(c)).unwrap_or(rest.len());
        let length = if rest.starts_with("//") {
            let line = rest.find('\n').unwrap_or(rest.len());
            rest = &rest[line..];
            continue;
        } else if first.is_ascii_alphanumeric() || first == '_' {
            let is_number = first.is_ascii_digit();
            end(if is_number {
                |c| c.is_ascii_alphanumeric() || c == '.'
            } else {
                |c| c.is_ascii_alphanumeric() || c == '_'
            })
        } else if first.is_whitespace() {
            end(char::is_whitespace)
        } else {
            first.len_utf8()
        };
        let (token, after) = rest.split_at(length);
        tokens.push(token);
        rest = after;
    }
    tokens
}

/// Declarations of a module.
fn items(source: &str) -> Vec<Item<'_>> {
    let mut items = Vec::new();
    let mut item = Vec::new();
    let mut depth = 0;
    for token in tokens(source) {
        match token {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if item.is_empty() && is_space(token) {
            continue;
        }
        item.push(token);
        if depth == 0 && (token == ";" || token == "}") {
            items.push(Item::new(&item));
            item.clear();
        }
    }
    items
}

impl<'a> Item<'a> {
    fn new(tokens: &[&'a str]) -> Self {
        let mut item = Self {
            name: "",
            tokens: Vec::new(),
            binding: None,
            size: None,
            by_invocation: false,
        };
        item.strip_attributes(tokens);
        // `fn NAME`, `struct NAME`, but `var<storage, read> NAME`.
        let words = || item.tokens.iter().skip_while(|token| is_space(token));
        let before_name = match words().next() {
            Some(&"var") => words().position(|&token| token == ">"),
            _ => Some(0),
        };
        let name = words()
            .skip(before_name.map_or(0, |index| index + 1))
            .find(|token| is_word(token));
        item.name = name.copied().unwrap_or_default();
        item
    }

    /// Takes over tokens but those of attributes, such as `@binding(3)`, whose values it keeps.
    fn strip_attributes(&mut self, tokens: &[&'a str]) {
        let mut index = 0;
        while index < tokens.len() {
            if tokens[index] != "@" {
                self.tokens.push(tokens[index]);
                index += 1;
                continue;
            }
            let value = tokens.get(index + 3).copied().unwrap_or_default();
            match tokens[index + 1] {
                "binding" => self.binding = value.parse().ok(),
                "workgroup_size" => self.size = value.parse().ok(),
                "builtin" => self.by_invocation |= value == "global_invocation_id",
                _ => {}
            }
            // `@`, name, and `(`, value, `)` if there is one; then a space.
            index += if tokens.get(index + 2) == Some(&"(") { 5 } else { 2 };
            index += usize::from(tokens.get(index).is_some_and(|token| is_space(token)));
        }
    }
}

/// Type of a variable.
fn after_colon<'a>(tokens: &[&'a str]) -> Vec<&'a str> {
    let type_of = tokens.iter().skip_while(|&&token| token != ":").skip(1);
    type_of
        .take_while(|&&token| token != ";")
        .copied()
        .filter(|token| !is_space(token))
        .collect()
}
