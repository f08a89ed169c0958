#!/usr/bin/env python3
"""Checks that comment lines of Rust files are at most as wide as rustfmt.toml says; with --fix, wraps those that are not.

rustfmt wraps comments by an unstable option only, and knows less of what must stay on a line. Tables, code, headings and words that are
wider themselves stay as they are.
"""

import pathlib
import re
import subprocess
import sys

WIDTH = int(re.search(r"^max_width = (\d+)", pathlib.Path("rustfmt.toml").read_text(), re.M).group(1))
COMMENT = re.compile(r"^(\s*//[/!]?)( ?)(.*)$")
# A list's item (its text is wrapped under itself), and lines that are not text.
ITEM = re.compile(r"^(\s*(?:[-*+]|\d+[.)])\s+)(.*)$")
FIXED = re.compile(r"^(?:\s{4,}|\||#|>|```|\[[^\]]+\]: |=+$|-+$|$)")
# What would begin a list, a heading, a quotation or a table if it stood first on a line.
OPENS = re.compile(r"^(?:[-*+>|#=]+|\d+[.)])$")


def pieces(text):
    """Words, where code and links' targets count as one word; none that would open a block may come first."""
    words = re.findall(r"(?:`[^`]*`|\]\([^)]*\)|\S)+", text)
    out = []
    for word in words:
        if out and OPENS.match(word):
            out[-1] += " " + word
        else:
            out.append(word)
    return out


def wrap(text, width):
    lines, line = [], ""
    for word in pieces(text):
        longer = f"{line} {word}" if line else word
        if line and len(longer) > width:
            lines.append(line)
            line = word
        else:
            line = longer
    return lines + [line]


def paragraphs(lines):
    """Splits a file into (lines, prefix, marker, indent): runs of comment lines that are one paragraph, and other lines one by one."""
    run, head, in_code = [], None, False
    for line in lines:
        match = COMMENT.match(line)
        prefix, body = (match.group(1), match.group(3)) if match else (None, "")
        if match and body.lstrip().startswith("```"):
            in_code = not in_code
        if not match:
            in_code = False
        item = ITEM.match(body) if match else None
        is_text = match and not in_code and match.group(2) and (item or not FIXED.match(body))
        # An item's other lines stand under its text; other lines under lists are left to people.
        goes_on = run and is_text and not item and prefix == head[0] and body.startswith(head[2])
        goes_on = goes_on and not body[len(head[2]) :].startswith(" ")
        if goes_on:
            run.append(line)
            continue
        if run:
            yield run, head
        run, head = [], None
        if not is_text:
            yield [line], None
            continue
        run = [line]
        head = (prefix, item.group(1), " " * len(item.group(1))) if item else (prefix, "", "")
        if not item and body.startswith(" "):
            lead = re.match(r" *", body).group()
            head = (prefix, lead, lead)
    if run:
        yield run, head


def wrapped(text):
    out = []
    for run, head in paragraphs(text.split("\n")):
        if head is None or all(len(line) <= WIDTH for line in run):
            out += run
            continue
        prefix, marker, indent = head
        bodies = [COMMENT.match(line).group(3) for line in run]
        body = " ".join([bodies[0][len(marker) :]] + [rest.strip() for rest in bodies[1:]])
        room = WIDTH - len(prefix) - 1 - len(marker)
        rows = wrap(body, room)
        out += [f"{prefix} {marker}{rows[0]}"] + [f"{prefix} {indent}{row}" for row in rows[1:]]
    return "\n".join(out)


def too_wide(text):
    """Numbers of the comment lines that could be narrower."""
    was, now = text.split("\n"), set(wrapped(text).split("\n"))
    return [i + 1 for i, line in enumerate(was) if len(line) > WIDTH and COMMENT.match(line) and line not in now]


def main():
    files = subprocess.run(["git", "ls-files", "*.rs"], check=True, capture_output=True, text=True).stdout.split()
    if not files:
        sys.exit("comments.py: found no Rust files; run it in the repository's root")
    count = 0
    for file in map(pathlib.Path, files):
        text = file.read_text("utf-8")
        numbers = too_wide(text)
        count += len(numbers)
        if numbers and "--fix" in sys.argv:
            file.write_text(wrapped(text), "utf-8")
        else:
            for number in numbers:
                print(f"{file}:{number}: a comment wider than {WIDTH}: `.ci/comments.py --fix` wraps it")
    if "--fix" not in sys.argv and count:
        return 1
    print(f"comments.py: {len(files)} files, {count} lines wrapped")


if __name__ == "__main__":
    sys.exit(main())
