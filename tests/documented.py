"""The commands in the README pages: those in fenced blocks, and those named in a sentence."""

import re
import shlex
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    page
    for folder in ("", "docker", "services/*", "services/mocap/*", "tests")
    for page in ROOT.glob(f"{folder}/*.md" if folder else "*.md")
)
_BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"`([^`]+)`")
_ASSIGNMENT = re.compile(r"\w+=.*")
_BEGINS = re.compile(r"xormocap |python3? -m |(\./)?scripts/\w|\.venv/bin/python ")
_COMMENT = re.compile(r"(?:^|[ \t])#.*$", re.MULTILINE)
_OPERATORS = "();<>|&\n"
_BEFORE_A_COMMAND = ("do", "then", "else", "exec")


@dataclass(frozen=True)
class Command:
    """A command as it stands on a page."""

    page: Path
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}: {shlex.join(self.words)}"


def blocks(page: Path) -> list[str]:
    """The scripts of a page: its fenced blocks of sh."""
    found = _BLOCK.findall(page.read_text(encoding="utf-8"))
    return [textwrap.dedent(script) for kind, script in found if kind == "sh"]


def commands_in_blocks(page: Path) -> list[Command]:
    """Every simple command in a page's scripts, without redirections and assignments."""
    return [Command(page, words) for script in blocks(page) for words in simple_commands(script)]


def commands_in_text(page: Path) -> list[Command]:
    """The commands that sentences and tables name; their arguments may be left out."""
    text = _BLOCK.sub("", page.read_text(encoding="utf-8"))
    named = [" ".join(code.split()) for code in _INLINE.findall(text)]
    return [Command(page, words) for code in named if _BEGINS.match(code) for words in simple_commands(code)]


def options_in_text(page: Path) -> set[str]:
    """The options that sentences and tables name by themselves, such as --no-check."""
    text = _BLOCK.sub("", page.read_text(encoding="utf-8"))
    return {found[0] for code in _INLINE.findall(text) if (found := re.match(r"--[a-z-]+", code))}


def simple_commands(script: str) -> list[tuple[str, ...]]:
    """The words of each command of a script, in order."""
    text = _COMMENT.sub("", script.replace("\\\n", " "))
    lexer = shlex.shlex(text, posix=True, punctuation_chars=_OPERATORS)
    lexer.whitespace, lexer.whitespace_split, lexer.commenters = " \t", True, ""
    commands: list[list[str]] = [[]]
    is_file = False
    for word in lexer:
        if set(word) <= set(_OPERATORS):
            is_file = word[0] in "<>"
            commands += [] if is_file else [[]]
        elif is_file:
            is_file = False
        elif commands[-1] or not (_ASSIGNMENT.fullmatch(word) or word in _BEFORE_A_COMMAND):
            commands[-1].append(word)
    return [tuple(words) for words in commands if words]
