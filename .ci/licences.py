#!/usr/bin/env python3
"""Holds the packages of Cargo.lock against deny.toml: licences, sources and banned names, as `cargo deny` does, in a second.

Run from the repository's root. `cargo deny check` says more, advisories among it, but takes minutes to install.
"""

import json
import re
import subprocess
import sys
import tomllib


def allowed(expression, allow, used):
    """Whether a licence expression (SPDX, or with the older '/') holds with licences of `allow` alone; adds those that it takes to `used`."""
    words = re.findall(r"\(|\)|[\w.+-]+", expression.replace("/", " OR "))

    def either():
        found = [both()]
        while words and words[0] == "OR":
            words.pop(0)
            found.append(both())
        return next((licences for licences in found if licences is not None), None)

    def both():
        found = [one()]
        while words and words[0] == "AND":
            words.pop(0)
            found.append(one())
        return None if None in found else set().union(*found)

    def one():
        word = words.pop(0)
        if word == "(":
            inner = either()
            words.pop(0)
            return inner
        if words and words[0] == "WITH":
            word = f"{word} WITH {words.pop(1)}"
            words.pop(0)
        return {word} if word in allow else None

    taken = either()
    used |= taken or set()
    return taken is not None


def main():
    with open("deny.toml", "rb") as file:
        rules = tomllib.load(file)
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    packages = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    foreign = [package for package in packages if package["source"]]
    if len(foreign) < 50:
        sys.exit(f"licences.py: found {len(foreign)} packages only: are these all?")
    allow, used = rules["licenses"]["allow"], set()
    banned = {rule["name"]: rule["reason"] for rule in rules["bans"]["deny"]}
    errors = []
    for package in foreign:
        name = f"{package['name']} {package['version']}"
        if not package["license"]:
            errors.append(f"{name}: names no licence: read its files, and add a [[licenses.clarify]]")
        elif not allowed(package["license"], allow, used):
            errors.append(f"{name}: {package['license']}: not among those that deny.toml allows")
        if package["source"] != "registry+https://github.com/rust-lang/crates.io-index":
            errors.append(f"{name}: comes from {package['source']}; expected crates.io")
        if package["name"] in banned:
            errors.append(f"{name}: banned: {banned[package['name']]}")
    errors += [f"deny.toml: no package needs {licence}: take it out" for licence in allow if licence not in used]
    print("\n".join(errors) if errors else f"licences.py: {len(foreign)} packages, {', '.join(sorted(used))}")
    return bool(errors)


if __name__ == "__main__":
    sys.exit(main())
