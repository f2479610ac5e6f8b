"""The documentation is correct: its code runs, the functions and tests it names exist, and its links lead to their
targets."""

import ast
import re
import shlex
import shutil
from importlib import import_module
from importlib.util import find_spec

import equation_index
import numpy as np
import pytest
import tomlkit

import taichi_mps as mps
from tests.support.child import ROOT, child

PACKAGE = ROOT / "taichi_mps"
ENGINE = PACKAGE / "engine"  # whose files and functions are named from here
DOCS = ROOT / "docs"
SITE = sorted(page for page in DOCS.rglob("*.md") if "notes" not in page.parts)  # what readers see
PAGES = [*SITE, ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "renders" / "README.md"]
ARCHITECTURE = (DOCS / "architecture.md").read_text(encoding="utf-8")
EQUATIONS = (DOCS / "equations.md").read_text(encoding="utf-8")
LAYERS = tomlkit.parse((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["taichi-mps"]["layers"]
EXAMPLES = {"terms/drag.py", "schemes/ballistic.py"}  # files that architecture.md shows how to add
# words, without generated tables; the architecture is an afternoon, not a book
BUDGETS = {"a user reads": 18_500, "theory and architecture": 10_500, "architecture": 1_248, "notes": 4_000}
MAX_OF_A_VERSION = 600  # words of the changelog
WITHOUT_INFLUENCE = {
    "DIFFERENCE",
    "NONE",
    "FALL",
    "DOUBTFUL_VOLUME_ERROR",
    "BLOCK",
    "HUGE",
    "MAX_ITERATIONS",
    "SPEED2_IF_NOT_FINITE",
    "MAX_LOST_FRACTION",
    "SUMS",
    "SOLVE",
    "RESIDUALS",
    "SAMPLE_SIZE",
}
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
CAPTION = re.compile(r"!\[[^\]]*\]\([^)]+\)\n\*(.+)\*$", re.M)
COMMAND = re.compile(r"`((?:taichi-mps|python) [^`]+)`")
FILE = re.compile(r"# file: (\S+\.py)\n")
DOTTED = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)`")
CALL = re.compile(r"`([a-z_]+\.[a-z_]+)\.([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)`")  # room.module, name
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
TESTS = re.compile(r"`(tests/[\w/]+\.py)?(?:::(\w+))?`")  # with no path: in the file that was named before
PYTHON = re.compile(r"`((?:\w+/)+\w+\.py)`")
IMPORT = re.compile(r"^(?:from (taichi_mps[\w.]*) import|import (taichi_mps[\w.]*))(?: (.+))?$", re.M)
LINKED = re.compile(r"\]\(api/(\w+)\.md#([\w.]+)\)")  # in the index of equations: page, name
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def modules():
    """Files of the package by their dotted names, those of the engine from there and from the package."""
    return {
        ".".join(path.relative_to(folder).with_suffix("").parts): path
        for folder in (PACKAGE, ENGINE)
        for path in folder.rglob("*.py")
    }


def names(path):
    """Functions, classes and members, as 'Class.member', that a module defines; of a record also its fields."""
    found = set()

    def collect(body, prefix=""):
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
            if isinstance(node, ast.AnnAssign) and prefix and isinstance(node.target, ast.Name):
                found.add(prefix + node.target.id)
            if isinstance(node, ast.ClassDef):
                collect(node.body, f"{node.name}.")

    collect(ast.parse(path.read_text(encoding="utf-8")).body)
    return found


def name_of(page):
    """A page from the root of the project."""
    return page.relative_to(ROOT).as_posix()


def files_of_the_pages(folder):
    """Python blocks that name a file become that file, for the commands that take it, beside forms and tool paths."""
    for file in (*DOCS.glob("figures/*.step"), *DOCS.glob("figures/*.gcode")):
        (folder / file.name).write_bytes(file.read_bytes())
    for page in SITE:
        for text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if file := FILE.match(text):
                (folder / file[1]).write_text(text, encoding="utf-8")


def script(page):
    """All Python blocks of a page but files, in order, as one script."""
    return "".join(text for text in BLOCK.findall(page.read_text(encoding="utf-8")) if not FILE.match(text))


@pytest.mark.long
@pytest.mark.parametrize("page", [page for page in SITE if page.parent.name == "howto" and script(page)], ids=name_of)
def test_python_blocks_run(page, tmp_path):
    files_of_the_pages(tmp_path)
    assert script(page).count("mps.init(") <= 1, "a second init would drop the simulations of the blocks before"
    (tmp_path / "page.py").write_text(script(page), encoding="utf-8")
    done = child("page.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


# ---- commands -------------------------------------------------------------------------------------------------------
def commands(text, captions=True):
    """Those of taichi-mps and python in the shell blocks of a page, and in the captions of its figures, as words."""
    lines = [line for language, block in FENCED.findall(text) if language in ("", "sh") for line in block.splitlines()]
    lines += [command for caption in CAPTION.findall(text) for command in COMMAND.findall(caption) if captions]
    for part in (part for line in lines for part in line.split(" && ") if re.search("taichi-mps|python", part)):
        words = shlex.split(part.split(" > ")[0], comments=True)
        words = words[words.index("taichi-mps") :] if "taichi-mps" in words else words
        if words[:1] in (["taichi-mps"], ["python"]):
            yield words


class ParsedError(BaseException):
    """A command line was read to its end, and its values were checked. No error, which a scene would tell as its
    own."""


@pytest.fixture
def parsing_only(monkeypatch):
    """The command line stops where it would begin to compute, to draw or to write."""
    from taichi_mps.cli import main, options, study
    from taichi_mps.engine.geometry.solid import Solid
    from taichi_mps.study import calibrate, calibrate_curves

    parse, problem, sample = options.Parser.parse, main.Problem, Solid.of

    def parsed(parser, argv):
        arguments = parse(parser, argv)
        if parser.prog.split()[-1] not in ("run", "sweep", "calibrate"):
            raise ParsedError
        return arguments

    def stop(*_, **__):
        raise ParsedError

    def check_problem(*arguments):
        problem(*arguments)
        raise ParsedError

    def sample_few(distance, low, high, cell, **keywords):
        if np.prod(np.subtract(high, low) / cell) > 1e7:
            raise ParsedError  # of a form that takes a minute, nothing but this is left to check
        return sample(distance, low, high, cell, **keywords)

    def check_measurements(study=None, check=True, lift_speed=None, **told):
        calibrate.Measurements(**told)
        raise ParsedError

    monkeypatch.setattr(options.Parser, "parse", parsed)
    monkeypatch.setattr(main, "Problem", check_problem)
    monkeypatch.setattr(Solid, "of", sample_few)
    monkeypatch.setattr(study, "sweep", stop)
    monkeypatch.setattr(calibrate_curves, "calibrate_curves", stop)
    monkeypatch.setattr(calibrate, "calibrate", check_measurements)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_are_read(page, parsing_only, tmp_path, monkeypatch, capsys):
    """Every command of the pages and of the captions exists with its options and values; nothing is computed."""
    from taichi_mps.__main__ import main

    files_of_the_pages(tmp_path)
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    for program, *words in dict.fromkeys(map(tuple, commands(text))):
        if program == "python" and words[0] == "-m":
            assert words[1] in ("pytest", "zensical", "tests.bounds", "validation"), words
            if words[1] == "validation":
                source = (ROOT / "validation/__main__.py").read_text(encoding="utf-8")
                assert all(word in source for word in words if word.startswith("--")), words
        elif program == "python" and (ROOT / words[0]).is_file():
            source = (ROOT / words[0]).read_text(encoding="utf-8")
            unknown = [word for word in words[1:] if re.match(r"[a-z-]", word) and word not in source]
            assert not unknown, f"{words[0]}: {unknown}"
        else:
            argv = ["run", *words] if program == "python" else words
            try:
                code = main(argv)
            except ParsedError:
                code = 0
            assert code == 0, f"{argv}: {capsys.readouterr().err}"


def shortened(words):
    """The same command with little time to simulate; None of one that needs other machines, an extra or a film."""
    extras = {"--film": "imageio_ffmpeg", "--surface": "pysplashsurf"}
    absent = any(find_spec(module) is None for option, module in extras.items() if option in words)
    elsewhere = any(word.startswith("dask://") for word in words)
    if absent or elsewhere or words[0] == "app" or {"--page", "--curve"} & set(words):
        return None
    if words[0] not in ("run", "resume", "sweep") or "--help" in words:
        return words
    return [*words, "--until", "0.03" if words[0] == "resume" else "0.02"]


@pytest.mark.long
@pytest.mark.parametrize("page", [page for page in SITE if page.parent != DOCS or page.stem == "start"], ids=name_of)
def test_commands_run(page, tmp_path):
    """The commands of a page run in its order in an empty folder, with the simulated time cut short."""
    files_of_the_pages(tmp_path)
    for program, *words in commands(page.read_text(encoding="utf-8"), captions=False):
        if program == "taichi-mps" and (words := shortened(words)):
            result = child("-m", "taichi_mps", *words, cwd=tmp_path)
            assert result.returncode == 0, f"{words}\n{result.stdout}{result.stderr}"


@pytest.mark.parametrize("page", SITE, ids=name_of)
def test_every_figure_names_the_command_that_makes_it(page):
    text = page.read_text(encoding="utf-8")
    for image, below in re.findall(r"(!\[[^\]]*\]\([^)]+\))\n?(.*)", text):
        caption = CAPTION.match(f"{image}\n{below}\n")
        assert caption and COMMAND.search(caption[1]), image


# ---- the site -------------------------------------------------------------------------------------------------------
def test_the_site_is_built_offline_without_a_warning(tmp_path):
    """The strict build finds every link, anchor and name of the API; pages load nothing from elsewhere, and equations
    are MathML."""
    pytest.importorskip("zensical", reason="zensical is not installed: pip install 'taichi-mps[docs]'")
    shutil.copytree(DOCS, tmp_path / "docs")
    for folder in (PACKAGE, ROOT / "tests"):
        shutil.copytree(folder, tmp_path / folder.name, ignore=shutil.ignore_patterns("__pycache__", "*.csv", "*.h5"))
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    result = child("-m", "zensical", "build", "--strict", cwd=tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    site = tmp_path / "build" / "site"
    pages = {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    assert {page.relative_to(DOCS).with_suffix(".html").as_posix() for page in SITE} <= set(pages)
    fetched = [url for text in pages.values() for url in re.findall(r'(?:src|link [^>]*href)="(https?:[^"]+)', text)]
    assert not fetched
    for page, name in LINKED.findall(EQUATIONS):  # each has its place on the site
        assert f'id="{name}"' in pages[f"api/{page}.html"], name
    assert "plastic viscosity of the mix" in pages["api/materials.html"], "fields of a record without what they are"
    for name, text in pages.items():
        shown = re.sub(r"<(code|pre|annotation|script)\b.*?</\1>", "", text, flags=re.S)
        assert "$" not in shown, f"{name}: mathematics that is not rendered"


def test_every_page_is_in_the_navigation():
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    assert named == {page.relative_to(DOCS).as_posix() for page in SITE}


@pytest.mark.parametrize("kind", BUDGETS)
def test_the_words_of_the_pages_keep_their_budget(kind):
    def written(page):
        text = re.sub(r"<!-- written by .*?<!-- end.*?-->", "", page.read_text(encoding="utf-8"), flags=re.S)
        return [word for word in text.split() if re.search(r"\w", word)]  # not the bars of tables

    theory = [*(DOCS / "theory").glob("*.md"), DOCS / "architecture.md"]
    by_command = [*(DOCS / "api").glob("*.md"), DOCS / "equations.md"]
    pages = {"theory and architecture": theory, "notes": (DOCS / "notes").glob("*.md")}
    pages["architecture"] = [DOCS / "architecture.md"]
    pages["a user reads"] = set(PAGES) - {*theory, *by_command}
    words = {name_of(page): len(written(page)) for page in sorted(pages[kind])}
    assert sum(words.values()) <= BUDGETS[kind], f"of {BUDGETS[kind]} words: {words}"


def test_one_thing_has_one_word():
    """The pages use one word for one thing, except in names of options and keys."""
    other = re.compile(r"\byield values?\b|slump-flow diameter|(?:viscous|pressure) iterations", re.I)
    scripts = [*PACKAGE.rglob("*.py"), *(ROOT / "scenes").glob("*.py")]
    for path in (*PAGES, *scripts):
        assert not other.findall(path.read_text(encoding="utf-8")), path


def test_the_changelog_begins_with_the_version_and_is_short():
    """A version that is released has its date, one in development its changes."""
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M)[1:]
    first = "Unreleased$" if "dev" in mps.__version__ else rf"{re.escape(mps.__version__)} - \d{{4}}-\d\d-\d\d$"
    assert re.match(first, versions[0].split("\n")[0])
    assert max(len(version.split()) for version in versions) <= MAX_OF_A_VERSION


def constant(file, name):
    """Value of a constant of a file of the package, or the default of a field of its record."""
    module = import_module("taichi_mps.engine." + file.removesuffix(".py").replace("/", "."))
    record, _, field = name.partition(".")
    return getattr(module, record).model_fields[field].default if field else getattr(module, name)


def test_the_table_of_constants_is_that_of_the_code():
    """Each constant of the table has that value in that file, and each number at the top of a module of terms or
    schemes is listed unless no result depends on it."""
    page = (DOCS / "theory" / "constants.md").read_text(encoding="utf-8")
    listed = set(WITHOUT_INFLUENCE)
    for cell, file, value in re.findall(r"^\| (`.*?) \| `(\S+\.py)` \| (.*?) \|", page, re.M):
        names = re.findall(r"`([\w.]+)`", cell)
        found = tuple(constant(file, name) for name in names)
        assert (found if len(names) > 1 else found[0]) == eval(value), f"{file}: {cell}"
        listed |= set(names)
    assert len(listed) > 50
    for path in [*(ENGINE / "terms").glob("*.py"), *(ENGINE / "schemes").glob("*.py")]:
        known = re.findall(r"^((?:[A-Z_]+, )*[A-Z_]+) = [-\d.]", path.read_text(encoding="utf-8"), re.M)
        assert not set(", ".join(known).split(", ")) - {"", *listed}, path


def test_the_api_has_every_public_name():
    from taichi_mps import __all__ as public

    shown, known = set(), modules()
    for name in equation_index.shown():
        shown |= {name.rsplit(".")[-1]} | (names(known[name]) if name in known else set())
    # modules, by what stands on their pages
    hidden = {"measure": "surface", "backend": "init", "ti": "init", "catalogue": "build", "checkpoint": "restore"}
    assert not {hidden.get(name, name) for name in public} - shown


def test_named_functions_exist():
    """Dotted names of the index, and those on any page that begin with a room and a module, are functions
    room.module.name."""
    known = modules()
    assert set(DOTTED.findall(EQUATIONS)) == {f"{module}.{name}" for module, name in CALL.findall(EQUATIONS)}
    assert len(CALL.findall(EQUATIONS)) > 100
    for page in PAGES:
        for module, name in CALL.findall(page.read_text(encoding="utf-8")):
            if page.stem == "equations" or module in known:
                assert module in known and name in names(known[module]), f"{page.name}: {module}.{name}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_named_files_and_imports_exist(page):
    """Files named with a folder, from the root of the project or of the package, and imports of Python blocks exist."""
    text = page.read_text(encoding="utf-8")
    for name in set(PYTHON.findall(text)) - EXAMPLES:
        assert any((folder / name).is_file() for folder in (ROOT, PACKAGE, ENGINE)), name
    for match in IMPORT.finditer("\n".join(BLOCK.findall(text))):
        module = (match[1] or match[2]).split(".")[1:]
        for name in (match[3] or "").split(", ") if match[1] and module else []:
            inside = PACKAGE.joinpath(*module)
            file = inside.with_suffix(".py")
            bound = (inside / f"{name}.py").is_file() or (
                file.is_file() and re.search(rf"\b{name}\b", file.read_text())
            )
            assert bound, match[0]


# ---- architecture.md ------------------------------------------------------------------------------------------------
def table(heading):
    """Rows of the tables below a heading, each as cells without marks of code."""
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", ARCHITECTURE, re.S | re.M)[1]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip().strip("`") for cell in row] for row in rows if row[0].strip() not in ("stage", "stop")]


def test_the_picture_of_the_rooms_is_that_of_the_project():
    picture = re.search(r"^## Rooms$.*?^```$(.*?)^```$", ARCHITECTURE, re.S | re.M)[1].strip().splitlines()
    assert [line.split()[0] for line in picture] == LAYERS
    assert all(len(line.split()) > 3 for line in picture), "a room without a word of what it is"


def test_the_stages_of_a_step_are_called_in_this_order_and_have_an_equation():
    def called(path):
        """Calls of stages in the order of step(), those of its own methods in their place."""
        tree = ast.parse((ENGINE / "schemes" / path).read_text(encoding="utf-8"))
        scheme = next(node for node in tree.body if isinstance(node, ast.ClassDef))
        methods = {node.name: node for node in scheme.body if isinstance(node, ast.FunctionDef)}

        def order(name):
            calls = [node for node in ast.walk(methods[name]) if isinstance(node, ast.Call)]
            for call in sorted(calls, key=lambda node: (node.lineno, node.col_offset)):
                text = ast.unparse(call.func).removeprefix("self.")
                yield from order(text) if text in methods else [text]

        return list(order("step"))

    rows = table("One time step")
    for path, first, last in (("implicit.py", "motion.drift", "diagnostics.report"),
                              ("semi_implicit.py", "viscosity.predict", "pressure.correct")):  # fmt: skip
        stages = [row[0] for row in rows]
        stages = stages[stages.index(first) : stages.index(last) + 1]
        calls = iter(called(path))
        assert len(stages) > 4 and all(stage in calls for stage in stages), path
    for row in rows:
        for label in re.findall(r"\([^)]+\)", row[3]) if len(row) > 3 else []:
            assert re.search(rf"^\| .*{re.escape(label)}", EQUATIONS, re.M), label


def test_the_stops_of_a_number_exist():
    stops = table("What a number passes through")
    assert 3 <= len(stops) <= 7
    for number, path, name, _ in stops:
        assert name in names(ROOT / path), f"stop {number}: {name} is not in {path}"


# ---- equations ------------------------------------------------------------------------------------------------------
def test_the_index_of_equations_is_up_to_date():
    for path, text in equation_index.index().items():
        assert path.read_text(encoding="utf-8") == text, "python docs/equation_index.py"


def test_every_equation_names_its_function_and_its_test():
    rows = [line.strip("| ").split(" | ") for line in EQUATIONS.splitlines() if line.startswith("| [(")]
    for row in rows:
        assert len(row) == 3 and CALL.search(row[1]) and TEST.search(row[2]), row
    labels = {label for _, group in equation_index.equations() for label in group}
    assert {str(k) for k in range(1, 30)} <= labels, "an equation of the paper is not in Theory"
    known = tomlkit.parse((DOCS / "equations.toml").read_text(encoding="utf-8"))
    assert {label for group in known for label in group.split(", ")} == labels


def test_every_label_in_the_code_is_an_equation_of_theory():
    labels = {label for _, group in equation_index.equations() for label in group}
    for path in [*PACKAGE.rglob("*.py"), *(ROOT / "tests").rglob("*.py")]:
        assert equation_index.cited(path.read_text(encoding="utf-8")) <= labels, path


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_named_tests_exist(page):
    path = None
    for file, name in TESTS.findall(page.read_text(encoding="utf-8")):
        path = ROOT / file if file else path
        assert path is None or path.is_file(), file
        assert not name or name in names(path), f"{path}::{name}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_resolve(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://", "#")):
            assert (page.parent / target.split("#")[0]).exists(), target
