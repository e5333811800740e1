"""What sources and pages cite is there: numbered paragraphs of docs/paper.md, pages, files, keys of a scenario."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, get_type_hints

import pytest

from agents.config import Rules

ROOT: Final = Path(__file__).resolve().parents[2]
PACKAGES: Final = ("agents", "bus", "deploy", "medium", "monitor_station", "tests", "vds", "world")
TEXTS: Final = (".md", ".pxi", ".py", ".pyi", ".pyx", ".toml")

PARAGRAPH: Final = re.compile(r"^\*\*(\d+\.\d+)\*\* \*(Paper|Ours)\b", re.MULTILINE)
CITATION: Final = re.compile(r"\[paper\s+([^\]]*)\]")
NUMBERS: Final = re.compile(r"\d+\.\d+(?:(?:, | to )\d+\.\d+)*")
UNSEEN: Final = re.compile(
    r"\b(?:PROCEDURE|DESIGN|POLICY)\b"  # notes that are not in the repository
    r"|\bRECORDING \d"
    r"|\bpaper,? (?:I{1,3}|IV)\b"  # a section of the paper instead of a paragraph of ours
    r"|\bpaper, (?:Fig|Sec|Tab)"
    r"|\bII-[A-C]\b"
)
FIGURE: Final = re.compile(r"\bFig\. \d")
BARE_README: Final = re.compile(r"\bREADME\b(?!\.md)")
PAGE: Final = re.compile(r"[\w./-]*\w\.md\b")
FILE: Final = re.compile(rf"(?<![\w/])(?:{'|'.join(PACKAGES)})/(?:[\w/-]*/|[\w/-]+\.(?:css|py|pyx|toml)\b)")
KEY: Final = re.compile(r"`rules\.(\w+)\.(\w+)(?: = [^`]*)?`")


def texts() -> Iterator[tuple[Path, str]]:
    """Every source and page of the repository but this file."""
    folders = (ROOT / name for name in (*PACKAGES, "docs"))
    inner = (path for folder in folders for path in folder.rglob("*"))
    for path in sorted([*ROOT.glob("*.md"), *ROOT.glob("*.toml"), *ROOT.glob("*.py"), *inner]):
        if path.suffix in TEXTS and path != Path(__file__).resolve():
            yield path.relative_to(ROOT), path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def paragraphs() -> list[str]:
    return [number for number, _ in PARAGRAPH.findall((ROOT / "docs/paper.md").read_text(encoding="utf-8"))]


def test_paragraphs_are_numbered_without_a_gap(paragraphs: list[str]) -> None:
    at = [tuple(map(int, number.split("."))) for number in paragraphs]
    for (section, number), following in itertools.pairwise(at):
        assert following in ((section, number + 1), (section + 1, 1))
    assert at[0] == (1, 1)


def test_every_citation_of_the_paper_resolves(paragraphs: list[str]) -> None:
    wrong, found = [], 0
    for path, text in texts():
        for cited in CITATION.findall(text):
            found += 1
            numbers = re.findall(r"\d+\.\d+", cited)
            if NUMBERS.fullmatch(" ".join(cited.split())) is None or not set(numbers) <= set(paragraphs):
                wrong.append(f"{path}: [paper {cited}]")
    assert wrong == []
    assert found > 50


def test_nothing_cites_a_document_that_is_not_here() -> None:
    wrong = [
        f"{path}: {found[0]}"
        for path, text in texts()
        if path != Path("docs/paper.md")
        for found in UNSEEN.finditer(text)
    ]
    assert wrong == []


def test_sources_cite_a_paragraph_beside_a_figure() -> None:
    """A figure is not in the repository; the paragraph that says what we know of it is."""
    wrong = [
        f"{path}: {' '.join(block.split())[:80]}"
        for path, text in texts()
        if path.parts[0] != "tests" and path.suffix in (".py", ".pyx", ".toml")
        for block in re.split(r'"""|\n\n|\n(?=\w+ = )', text)
        if FIGURE.search(block) and not CITATION.search(block) and "no figures" not in block
    ]
    assert wrong == []


def test_sources_name_the_page_that_they_mean() -> None:
    """README has a few commands only; rules stand on pages of their own."""
    wrong = [
        f"{path}: {found[0]}"
        for path, text in texts()
        if path.suffix in (".py", ".pyx", ".pyi") and path.parts[0] in PACKAGES
        for found in BARE_README.finditer(text)
    ]
    assert wrong == []


def test_every_page_that_is_named_is_there() -> None:
    wrong = [
        f"{path}: {named}"
        for path, text in texts()
        for named in PAGE.findall(text)
        if not any((folder / named).exists() for folder in (ROOT, ROOT / "docs", ROOT / path.parent))
    ]
    assert wrong == []


def test_every_file_that_a_page_names_is_there() -> None:
    wrong = [
        f"{path}: {named}"
        for path, text in texts()
        if path.suffix == ".md" and path != Path("CHANGELOG.md")
        for named in FILE.findall(text)
        if not (ROOT / named).exists()
    ]
    assert wrong == []


@pytest.mark.parametrize("page", ["paper.md", "scout.md"])
def test_every_parameter_that_a_page_names_is_a_key_of_a_scenario(page: str) -> None:
    tables = {field.name: get_type_hints(Rules)[field.name] for field in dataclasses.fields(Rules)}
    named = KEY.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))
    assert named
    for table, key in named:
        assert key in {field.name for field in dataclasses.fields(tables[table])}, f"rules.{table}.{key}"
