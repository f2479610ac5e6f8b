"""A case as a file: scene, mix, numerics and output in TOML, each number with a word and its unit."""

from pathlib import Path

from ..engine import LAW_OF, NUMERICS, Implicit
from ..input import catalogue
from ..input.labels import OPTIONS, keyword_description
from ..report.inputs import OMITTED, option
from ..units import SceneError, regular_file, require, suggestion, unit_of, user_path
from .options import GROUPS, Run, group_of, is_tuple, suggested

KEYS = {option.replace("-", "_"): key for key, option in OPTIONS.items()}  # keywords by the names of options
SECTIONS = [group.split()[0] for group in GROUPS]
NOT_IN_CASE = {"out", "overwrite", "quiet", "verbose", "profile"}  # options that a case file does not hold
KEYS_OF_0_2 = {"plots", "renderer", "source", "gradient"}  # which a case of version 0.2 has
MAX_BYTES = 1e5  # of a case file, which takes a second to read; a case has some 5e3
TITLE = "A case of taichi-mps: taichi-mps run case.toml. A number may have a unit of its own, in quotes: '0.5 kPa'."


def case_text(source: str, problem, settings: dict) -> str:
    """The case file of a problem whose scene comes from a ``source``, with the options of its run."""
    import tomlkit

    document = tomlkit.document()
    document.add(tomlkit.comment(TITLE))
    document.add("scene", tomlkit.item(source))
    tables = {name: tomlkit.table() for name in SECTIONS}
    known = keywords(catalogue.load(source), type(problem.numerics))
    given = {key: value for key, value in problem.scene.parameters.items() if value is not None and key not in OMITTED}
    values = {**problem.numerics.model_dump(), **settings, **given}
    for name, (model, field) in known.items():
        table = tables[group_of(name, model).split()[0]]
        unit = unit_of(field).strip("-")
        comment = (field.description or keyword_description(name)) + (f" [{unit}]" if unit else "")
        if values.get(name) is None:
            table.add(tomlkit.comment(f"{name} =  # {comment}"))
        else:
            table.add(name, tomlkit.item(values[name]).comment(comment))
    for name, table in tables.items():
        document.add(tomlkit.nl())
        document.add(name, table)
    return tomlkit.dumps(document)


def keywords(function, numerics) -> dict:
    """Return all keywords of a case of a scene function, {key: (its model, its field)}."""
    found = {}
    for model in (function.parameters, numerics, Run):
        for name, field in model.model_fields.items():
            if name not in NOT_IN_CASE:
                found.setdefault(name, (model, field))
    return found


def command_words(path: Path) -> list[str]:
    """Convert a case file to words of the command line: the scene and an option for each key. SceneError for another
    file, an unknown section or key, or a value that is no number, text or switch."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        data = regular_file(f"case = {path}", path, MAX_BYTES).read_bytes()
        encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"  # of PowerShell, of Notepad
        case = tomlkit.parse(data.decode(encoding)).unwrap()
    except (OSError, UnicodeError) as error:
        raise SceneError(f"case = {path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    except TOMLKitError as error:
        raise SceneError(f"case = {path}: is no TOML: {error}") from None
    source = case.pop("scene", None)
    require(
        isinstance(source, str),
        f"case = {path}: scene {'is missing' if source is None else f'= {source}'}; "
        f"must be one of {', '.join(catalogue.names())}, or a file",
    )
    if source.endswith(".py"):
        source = str(path.parent / user_path(source))
    given: dict = {}
    for section, keys in case.items():
        require(section in SECTIONS, f"case = {path}: unknown section '{section}'{suggestion(section, SECTIONS)}")
        require(isinstance(keys, dict), f"case = {path}: {section} = {keys}: must be one section, [{section}]")
        if duplicates := sorted(given.keys() & keys.keys()):
            raise SceneError(f"case = {path}: {duplicates[0]} is given twice")
        given |= keys
    known = keywords(catalogue.load(source), NUMERICS.get(str(given.get("scheme")), Implicit))
    options, words = [], {}
    for word, value in given.items():
        name = word if word in known else KEYS.get(word, word)
        older = "; version 0.3.0 reads a case of version 0.2" * (word in KEYS_OF_0_2)
        require(name in known, f"case = {path}: unknown key '{word}'{suggested(word, known)}{older}")
        require(name not in words, f"case = {path}: {word} is given twice, also as {words.get(name)}")
        words[name] = word
        switch = known[name][1].annotation is bool
        require(
            isinstance(value, bool) == switch,
            f"case = {path}: {name} = {str(value).lower()}: must be {'true or false' if switch else 'no switch'}",
        )
        require(
            isinstance(value, str | int | float)
            or (is_tuple(known[name][1]) and isinstance(value, list) and "," not in "".join(map(str, value))),
            f"case = {path}: {name} = {value}: must be a number or a text",
        )
        # a switch that is off has no option, and a number of the mix at its default must not choose a law
        if value != known[name][1].default or not (isinstance(value, bool) or name in LAW_OF):
            options.append(option(name, value, known))
    return [source, *options]


def expand_case_file(argv) -> list[str]:
    """Replace the first case file in a command line by its words; options after it override its keys."""
    for k, word in enumerate(argv):
        if word.endswith(".toml") and not word.startswith("-") and (k == 0 or user_path(word).is_file()):
            return [*argv[:k], *command_words(user_path(word)), *argv[k + 1 :]]
    return list(argv)
