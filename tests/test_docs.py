"""Everything the documentation shows is run: the README, the pages, the docstrings, the examples."""

import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import streamseg as ss

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
WITH_CODE = [page for page in PAGES if "```python" in page.read_text()]


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_code_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    code = "\n".join(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.S | re.M))
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.name)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-W", "error", example], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_readme_tells_the_commands_that_there_are(tmp_path: Path) -> None:
    text = (ROOT / "README.md").read_text()
    ss.scenes.write(tmp_path / "strip.laz", "airborne", 20_000)
    commands = re.findall(r"^(streamseg [^#\n]*)", text, re.M)
    assert len(commands) >= 5
    for command in commands:
        words = command.split()
        done = subprocess.run(
            [sys.executable, "-m", "streamseg", *words[1:]], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "labelled.png").stat().st_size > 1000


def test_links_between_pages_lead_somewhere() -> None:
    for page in [*PAGES, ROOT / "ARCHITECTURE.md", ROOT / "CHANGELOG.md"]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


MODULES = ["streamseg", *(name for _, name, _ in pkgutil.walk_packages(ss.__path__, "streamseg."))]


@pytest.mark.parametrize("name", [name for name in MODULES if not name.endswith("__main__")])
def test_docstring_examples(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        module = importlib.import_module(name)
        failed = doctest.testmod(module, extraglobs=vars(ss) if name == "streamseg._core" else {}).failed
    assert failed == 0


@pytest.mark.parametrize("name", sorted(ss.__all__))
def test_everything_public_is_documented(name: str) -> None:
    public = getattr(ss, name)
    assert public.__doc__ is not None
    if callable(public) and name[0].islower():
        assert "Parameters\n" in public.__doc__ or "Parameters" in public.__doc__
        assert "Examples" in public.__doc__ or name == "preview"


@pytest.mark.parametrize("name", ["Proximity", "SpanByWidth", "SpanByCount", "SpanByTime", "SpanByScanLine", "Window"])
def test_examples_of_the_compiled_classes(name: str) -> None:
    # doctest does not look into compiled modules by itself.
    tests = doctest.DocTestFinder(recurse=False).find(getattr(ss, name), name, module=False, globs=dict(vars(ss)))
    assert sum(len(test.examples) for test in tests) > 0
    assert sum(doctest.DocTestRunner().run(test).failed for test in tests) == 0
