#!/usr/bin/env python3
"""Checks what Markdown files say: one word for one thing, British spelling, and no command or source file that does not exist. Of Rust
sources, string literals and documentation are checked for the words.

Run from the repository's root: .ci/documents.py [FILE.md FILE.rs …]. Without files, all that git tracks are read.
"""

import json
import pathlib
import re
import subprocess
import sys

# Words that this project once had for what ARCHITECTURE.md calls otherwise ("Terms"), as patterns, and the term.
WORDS = {
    r"(?:temporal )?lightmap sets?": "dataset, or frames",
    r"moments?": "time (of day)",
    r"what shines": "emitters",
    r"(?:is|are|was|were) told|told errors?": "estimated",
    r"(?:open|closed) cells?": "unconverged or converged cell",
    r"trial (?:samples?|trainings?|runs?)": "pilot samples, or trial fit",
    r"standing (?:outputs?|datasets?|work|bakes?)": "existing",
    r"bright looks?": "bright-surface sample",
    r"what was left out": "what was skipped or omitted",
    r"that is none": "a plain 'not'",
    r"it wants": "it needs",
}
# Those that say nothing wrong in code: moments of statistics, what is told apart, a lamp that shines.
PROSE_ONLY = {r"moments?", r"what shines", r"(?:is|are|was|were) told|told errors?"}
# British spelling, in prose.
BRITISH = {
    r"colors?": "colour",
    r"(un)?colored": "coloured",
    r"gray": "grey",
    r"neighbors?|neighboring": "neighbour",
    r"behaviors?": "behaviour",
    r"centers?|centered": "centre",
    r"meters": "metres",
    r"\w+[aeiou]lizations?|\w+ormaliz(?:e|es|ed|ing)": "-is-",
    r"(?:optim|quant|initial|normal|minim|maxim|summar|recogn|organ|visual|general)iz\w+": "-is-",
    r"analyz(?:e|es|ed|ing)": "analyse",
    r"modeling|labeled|traveling": "-ll-",
    r"artifacts?": "artefact",
}


def prose(text):
    """The text with code, links' targets and quotations blanked, so that lines keep their numbers."""

    def blank(match):
        return re.sub(r"[^\n]", " ", match.group())

    text = re.sub(r"^( *)```.*?^\1```", blank, text, flags=re.M | re.S)
    text = re.sub(r"^(?: {4}|\t)(?![-*0-9]).*$", blank, text, flags=re.M)
    text = re.sub(r"`[^`]*`", blank, text)
    return re.sub(r"\]\([^)\s]*\)|https?://\S+|<[^>\n]+>", blank, text)


# Documentation of some lines, another comment, a raw string, a string, a character.
TOKEN = re.compile(
    r"""(?P<doc>(?:[ \t]*//[/!][^\n]*\n?)+)|//[^\n]*|b?r(?P<hashes>\#*)"(?P<raw>.*?)"(?P=hashes)|b?"(?P<text>(?:\\.|[^"\\])*)"|"""
    r"""'(?:\\.[^']*|[^'\\\n])'""",
    re.S,
)


def check_rust(path, text):
    """What string literals and documentation say."""
    for token in TOKEN.finditer(text):
        said = re.sub(r"(?m)^[ \t]*//[/!]", "", token["doc"] or token["raw"] or token["text"] or "")
        said = re.sub(r"`[^`]*`", "", said)
        for pattern, instead in WORDS.items():
            if pattern in PROSE_ONLY:
                continue
            words = pattern.replace(" ", r"\s+")
            for match in re.finditer(rf"(?<![\w-])(?:{words})(?![\w-])", said, re.I):
                line = 1 + text.count("\n", 0, token.start()) + said.count("\n", 0, match.start())
                yield f"{path}:{line}: '{' '.join(match.group().split())}': write: {instead}"


def targets():
    """Names of what cargo can build, by kind."""
    out = subprocess.run(
        ["cargo", "metadata", "--no-deps", "--offline", "--format-version", "1"], check=True, capture_output=True
    ).stdout
    found = {"package": set(), "bin": set(), "example": set(), "bench": set(), "test": set()}
    for package in json.loads(out)["packages"]:
        found["package"].add(package["name"])
        for target in package["targets"]:
            for kind in target["kind"]:
                if kind in found:
                    found[kind].add(target["name"])
    return found


def check(path, text, cargo, tracked):
    def line(at):
        return f"{path}:{text.count(chr(10), 0, at) + 1}"

    plain = prose(text)
    # (Capitals of American words belong to names: Unreal's "Emissive Color".)
    for words, advice, flags in ((WORDS, "write", re.I), (BRITISH, "British spelling", 0)):
        for pattern, instead in words.items():
            for match in re.finditer(rf"(?<![\w-])(?:{pattern})(?![\w-])", plain, flags):
                yield f"{line(match.start())}: '{match.group()}': {advice}: {instead}"
    # Options of cargo that name a target, wherever they stand; what follows a bare `--` is not cargo's.
    for command in re.finditer(r"\bcargo(?: \+\w+)? (?:run|test|bench|build|install|package|rustc)\b[^`\n|]*", text):
        words = command.group().split(" -- ")[0]
        for option, name in re.findall(r"(-p|--package|--bin|--example|--bench|--test)[ =]([\w-]+)", words):
            kind = {"-p": "package"}.get(option, option.lstrip("-"))
            if name not in cargo[kind]:
                yield f"{line(command.start())}: no {kind} is called '{name}': {command.group().strip()}"
    # Source files are named from the root, from their crate, from this document, or by their last parts.
    for match in re.finditer(r"`((?:[\w.-]+/)*[\w-]+\.(?:rs|wgsl|js|mjs|py|sh|h))`", text):
        name = match.group(1).removeprefix("../")
        if not any(file == name or file.endswith("/" + name) for file in tracked):
            yield f"{line(match.start())}: no source file is called '{name}'"


def main():
    tracked = subprocess.run(["git", "ls-files"], check=True, capture_output=True, text=True).stdout.split("\n")
    paths = sys.argv[1:] or [
        file
        for file in tracked
        if file.endswith(".md") and "third_party" not in file or re.match(r"(?:baker|dataset|compressor)/src/.*\.rs$", file)
    ]
    cargo = targets()
    if not paths or not cargo["bin"]:
        sys.exit("documents.py: found nothing to check; run it in the repository's root")
    found = []
    for path in paths:
        text = pathlib.Path(path).read_text("utf-8")
        found += check_rust(path, text) if path.endswith(".rs") else check(path, text, cargo, tracked)
    print("\n".join(found) if found else f"documents.py: {len(paths)} files are in order")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
