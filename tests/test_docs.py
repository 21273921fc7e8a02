"""Everything the documentation shows is run: the README, the pages, the docstrings, the examples."""

import doctest
import importlib
import inspect
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import streamseg as ss
from streamseg.cli.methods import METHODS

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


def commands(page: Path) -> list[list[str]]:
    """The words of a page's commands."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(), re.S | re.M)
    lines = [line for language, block in blocks if language != "python" for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("streamseg ")]


def announce_heaps(folder: Path) -> None:
    """Install a package with the plug-in that a page tells of."""
    (folder / "my_package.py").write_text(
        "def heaps(window, *, apart=1.0):\n    return (window.points[:, 0] // apart).astype(int)\n"
    )
    told = folder / "my_package-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text("[streamseg.segmentors]\nheaps = my_package:heaps\n")


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cloud that stands in for the reader's."""
    return ss.scenes.write(tmp_path_factory.mktemp("docs") / "strip.laz", "airborne", 20_000)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if commands(page)], ids=lambda page: str(page.relative_to(ROOT))
)
def test_the_commands_of_a_page_run(page: Path, strip: Path, tmp_path: Path) -> None:
    announce_heaps(tmp_path)
    for words in commands(page):
        given = tmp_path / words[2]
        if given.suffix == ".laz" and not given.exists():
            shutil.copy(strip, given)
        done = subprocess.run(
            [sys.executable, "-W", "error", "-m", *words], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
        pictures = [tmp_path / word for word in words if word.endswith(".png")]
        assert all(picture.stat().st_size > 1000 for picture in pictures)


def test_the_pages_show_commands() -> None:
    told = {words[1] for words in commands(ROOT / "README.md")}
    assert told >= {"segment", "resolve", "info", "preview", "verify", "export"}
    assert sum(bool(commands(page)) for page in PAGES) >= 5


def test_the_readme_has_a_command_for_every_segmentor(tmp_path: Path) -> None:
    text = (ROOT / "README.md").read_text()
    ss.scenes.write(tmp_path / "strip.laz", "airborne", 20_000)
    options = [shlex.split(words) for words in re.findall(r"^\| \[`.*\| `(--[^`]*)` \|", text, re.M)]
    assert sorted(words[1] for words in options) == ["1", *sorted(set(METHODS) - {"proximity"})]
    for words in options:
        command = [sys.executable, "-W", "error", "-m", "streamseg", "segment", "strip.laz", "out.laz", "--overwrite"]
        done = subprocess.run([*command, *words], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, f"{words}: {done.stderr}"


def in_words(run: ss.Stream) -> str:
    return f"{run.exactness}, identical" if run.is_identical else run.exactness


def test_exactness_is_what_the_table_says() -> None:
    text = (ROOT / "docs" / "exactness.md").read_text()
    rows = re.findall(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \|", text, re.M)
    assert len(rows) >= 10
    known = {**vars(ss), "d": 1.0, "r": 1.0, "eps": 1.0, "your_own": lambda window: [0] * len(window)}
    cloud = np.zeros((1, 3))
    for code, by_width, in_stream_order in rows:
        segmentor = eval(code, known)
        assert in_words(ss.stream(cloud, segmentor, spans=ss.SpanByWidth(50.0))) == by_width, code
        assert in_words(ss.stream(cloud, segmentor, spans=ss.SpanByCount(50))) == in_stream_order, code
        if code != "your_own":
            assert in_words(ss.stream(cloud, segmentor, spans=ss.SpanByCount(50), revisit=True)) == (
                by_width if by_width.endswith("identical") else in_stream_order
            ), code
        if in_stream_order == "A":
            assert in_words(ss.stream(iter([cloud]), segmentor, revisit=True)) == "A, identical", code
    running = ss.StatisticalOutlierRemoval(statistics="running")
    for segmentor in (ss.Proximity(1.0, graph="radius"), ss.Dbscan(1.0), ss.RegionGrowing(search_radius=1.0)):
        preprocessed = in_words(ss.stream(cloud, segmentor, spans=ss.SpanByWidth(50.0), preprocess=ss.VoxelGrid(1.0)))
        assert preprocessed == "B, identical"
        assert in_words(ss.stream(cloud, segmentor, spans=ss.SpanByWidth(50.0), preprocess=running)) == "C"
    assert in_words(ss.stream(cloud, ss.Proximity(1.0), preprocess=ss.VoxelGrid(1.0))) == "C"


def heading_anchors(page: Path) -> set[str]:
    """Name the headings of a page as links do."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_between_pages_lead_somewhere() -> None:
    for page in [*PAGES, ROOT / "ARCHITECTURE.md", ROOT / "CHANGELOG.md", ROOT / "BENCHMARKS.md"]:
        for target, anchor in re.findall(r"\]\(([^)#:]*)(?:#([^)]*))?\)", page.read_text()):
            place = page.parent / target if target else page
            assert place.exists(), f"{page.name} links to {target}"
            assert not anchor or anchor in heading_anchors(place), f"{page.name} links to {target}#{anchor}"


def test_every_page_can_be_reached_from_the_readme() -> None:
    found, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page not in found:
            found.add(page)
            targets = re.findall(r"\]\(([^)#:]+\.md)[)#]", page.read_text())
            waiting += [(page.parent / target).resolve() for target in targets]
    assert set(PAGES) <= found


def test_every_segmentor_has_a_page() -> None:
    pages = {page.stem for page in (ROOT / "docs" / "segmentors").glob("*.md")}
    names = [name for name in ss.__all__ if isinstance(getattr(ss, name), type)]
    built_in = [name for name in names if issubclass(getattr(ss, name), ss.Segmentor) and name != "Segmentor"]
    assert {re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower() for name in built_in} | {"your-own", "options"} <= pages


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
        assert "Parameters\n" in public.__doc__ or not inspect.signature(public).parameters
        assert "Examples" in public.__doc__ or name == "preview"


COMPILED = [
    *["ConditionalClustering", "Dbscan", "PlaneExtraction", "Proximity", "RegionGrowing"],
    *["RadiusOutlierRemoval", "StatisticalOutlierRemoval", "VoxelGrid"],
    *["SpanByCount", "SpanByScanLine", "SpanByTime", "SpanByWidth", "Window"],
]


@pytest.mark.parametrize("name", COMPILED)
def test_examples_of_the_compiled_classes(name: str) -> None:
    # doctest does not look into compiled modules by itself.
    tests = doctest.DocTestFinder(recurse=False).find(getattr(ss, name), name, module=False, globs=dict(vars(ss)))
    assert sum(len(test.examples) for test in tests) > 0
    assert sum(doctest.DocTestRunner().run(test).failed for test in tests) == 0
