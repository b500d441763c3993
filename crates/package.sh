#!/usr/bin/env bash
# Archives of all crates: `crates/package.sh FOLDER`. Sources lie in src/ for all crates together, and Cargo packs only what lies beside a
# manifest: each crate is laid out in a folder of its own, with the same paths below it, and packed there. Each archive is checked by itself.
set -euo pipefail
mkdir -p "$1"
out=$(realpath "$1")
cd "$(dirname "$0")/.."
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT

# Tests, benches and examples stay in the repository; unit tests do not build from an archive.
manifest() { awk '/^\[/ { skip = /^\[\[(test|bench|example)\]\]/ } !skip' "$1" | sed -e 's#"\.\./\.\./#"#' -e 's#crates/##'; }
lay_out() { # folder, sources
    local folder=$1
    shift
    mkdir -p "$folder/src"
    cp -r "$@" "$folder/src/"
    cp LICENSE-* README.md "$folder/"
    for shared in shaders assets; do
        if grep -rq "/$shared/" "$folder/src"; then cp -r "$shared" "$folder/"; fi
    done
}
for file in crates/*/Cargo.toml; do
    if grep -q '^publish = false' "$file"; then continue; fi
    name=$(basename "$(dirname "$file")")
    lay_out "$stage/$name" "src/${name#insonify-}"
    manifest "$file" > "$stage/$name/Cargo.toml"
done
lay_out "$stage" src/lib.rs src/input* src/run* src/solve* src/simulator*
manifest Cargo.toml | sed -e '/^members = /s#"\*"#"insonify-*"#' -e '/^default-members = /s#"\*"#"insonify-*"#' -e '/^insonify-testing/d' > "$stage/Cargo.toml"
sed -i '/^insonify-testing/d' "$stage"/*/Cargo.toml
cp Cargo.lock "$stage/"
(cd "$stage" && cargo package --workspace --allow-dirty --no-verify --target-dir "$stage/target")
cp "$stage"/target/package/*.crate "$out/"

# Each archive by itself, against the others: checked, as code is generated from the same sources in the repository.
unpacked=$stage/unpacked
mkdir "$unpacked"
for archive in "$out"/*.crate; do tar -xzf "$archive" -C "$unpacked"; done
{
    printf '[workspace]\nmembers = ["*"]\nresolver = "3"\n\n[patch.crates-io]\n'
    for folder in "$unpacked"/*/; do
        folder=$(basename "$folder")
        echo "${folder%-[0-9]*} = { path = \"$folder\" }"
    done
} > "$unpacked/Cargo.toml"
cp Cargo.lock "$unpacked/"
for folder in "$unpacked"/*/; do
    rm -f "$folder/Cargo.lock"
    name=$(basename "$folder")
    echo "== ${name%-[0-9]*} by itself"
    (cd "$unpacked" && cargo check -p "${name%-[0-9]*}" --target-dir "$stage/target")
done
ls -l "$out"
