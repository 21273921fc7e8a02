"""ARCHITECTURE.md tells who may import whom; here it is kept."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CORE = ROOT / "src"
PACKAGE = ROOT / "python" / "streamseg"


def rust_modules() -> dict[str, str]:
    """Top-level module → the text of all its files, comments, tests and doc examples left out."""
    texts: dict[str, str] = {}
    for path in sorted(CORE.rglob("*.rs")):
        relative = path.relative_to(CORE)
        module = relative.parts[0].removesuffix(".rs")
        code = re.split(r"#\[cfg\((?:all\()?test", path.read_text())[0]
        code = "\n".join(line.split("//")[0] for line in code.splitlines())
        texts[module] = texts.get(module, "") + code
    return texts


def table(heading: str) -> dict[str, set[str]]:
    """Read the import table below a heading of ARCHITECTURE.md: module → modules it may import."""
    section = (ROOT / "ARCHITECTURE.md").read_text().split(heading)[1].split("\n## ")[0]
    allowed: dict[str, set[str]] = {}
    for modules, imports in re.findall(r"^\| ((?:`\w+/?`\s*)+) \|.*\| ([^|]*) \|$", section, re.M):
        names = set(re.findall(r"`(\w+)/?`", imports))
        for module in re.findall(r"`(\w+)/?`", modules):
            allowed[module] = {"*"} if "everything" in imports else names
    return allowed


RUST = rust_modules()
RUST_TABLE = table("## The core")


@pytest.mark.parametrize("module", sorted(set(RUST) - {"lib"}))
def test_core_imports_are_those_of_the_table(module: str) -> None:
    assert module in RUST_TABLE, f"ARCHITECTURE.md does not name src/{module}"
    imported = set(re.findall(r"crate::(\w+)", RUST[module])) - {module}
    allowed = RUST_TABLE[module]
    assert allowed == {"*"} or imported <= allowed, f"src/{module} imports {imported - allowed}"


def test_the_table_names_only_what_there_is() -> None:
    assert set(RUST_TABLE) == set(RUST) - {"lib"}


@pytest.mark.parametrize(
    ("pattern", "places"),
    [
        (r"\bspade::", {"neighborhood/delaunay/*"}),
        (r"\bpest(_derive)?::", {"expression/*"}),
        (r"\brusqlite::", {"disk/database.rs", "revisit/store.rs", "weaver/ledger.rs"}),
        (r"\bpyo3::|\bnumpy::", {"python/*", "python/*/*"}),
        (r"\bAtomic\w+", {"sync.rs", "weaver/point_segment.rs", "weaver/segment_segment.rs"}),
        (r"\brayon::", {"crew.rs"}),
        (r"\bunsafe\b", set()),
    ],
)
def test_each_of_these_stays_in_its_place(pattern: str, places: set[str]) -> None:
    found = set()
    for path in CORE.rglob("*.rs"):
        code = "\n".join(line.split("//")[0] for line in path.read_text().splitlines())
        relative = path.relative_to(CORE)
        if re.search(pattern, code) and not any(relative.match(place) for place in places):
            found.add(str(relative))
    assert not found


def python_imports(path: Path) -> set[str]:
    """Name the modules of the package that a file imports, at any depth."""
    found: set[str] = set()
    package = path.relative_to(PACKAGE).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            parts = (*base, *(node.module or "").split(".")) if node.module else base
            found |= {parts[0]} if parts else {alias.name for alias in node.names}
    return found


PYTHON_TABLE = table("## The package")
PYTHON_FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")


@pytest.mark.parametrize("path", PYTHON_FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_package_imports_are_those_of_the_table(path: Path) -> None:
    module = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    assert module in PYTHON_TABLE, f"ARCHITECTURE.md does not name {module}"
    imported = python_imports(path) - {module}
    allowed = PYTHON_TABLE[module]
    assert allowed == {"*"} or imported <= allowed, f"{module} imports {imported - allowed}"


def takes_laspy(path: Path) -> bool:
    """Whether a file imports laspy or lazrs, or their name from another file."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
            if {"laspy", "lazrs"} & {name.split(".")[0] for name in names}:
                return True
    return False


def test_laspy_has_few_places() -> None:
    importers = {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if takes_laspy(path)}
    io = {f"io/{name}.py" for name in ("las", "las_layout", "las_writer", "laz_decoder")}
    assert importers == {"scenes.py", *io}


def test_nothing_is_called_utils() -> None:
    names = {"utils", "util", "common", "helpers", "misc"}
    assert not [path for path in [*CORE.rglob("*"), *PACKAGE.rglob("*")] if path.stem in names]
