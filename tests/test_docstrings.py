"""Public docstrings are complete: each parameter and result is described, every name has an example, and examples
run."""

import doctest
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from inspect import Parameter, getmembers, isclass, isfunction, ismethod, ismodule, signature
from pkgutil import resolve_name

import pytest

from taichi_mps.units import Checked
from tests.support.child import ROOT, child

API = ROOT / "docs" / "api"
PAGES = [page.read_text(encoding="utf-8") for page in sorted(API.glob("*.md")) if page.stem != "functions"]
SHOWN = re.findall(r"^::: taichi_mps\.(\S+)$", "".join(PAGES), re.M)
COMPILING = {"engine.simulation.simulation", "io.checkpoint", "viz.render"}  # modules whose examples compile kernels
OF_KERNELS = {"shear_stress", "growth"}  # Taichi compiles them, and refuses the types of arrays
NO_RESULT = {None, "None", type(None)}


def public():
    """(name, object) of every class and function on the pages of the API; of a module all that it defines."""
    for name in SHOWN:
        item = resolve_name(f"taichi_mps.{name}")
        if ismodule(item):
            own = [(key, it) for key, it in getmembers(item) if getattr(it, "__module__", "") == item.__name__]
            yield from ((f"{name}.{key}", it) for key, it in own if key[0] != "_")
        else:
            yield name, item


PUBLIC = dict(public())
MODULES = sorted({PUBLIC[name].__module__.removeprefix("taichi_mps.") for name in PUBLIC})


def section(text, title):
    """Lines of a section of a docstring in numpydoc."""
    found = re.search(rf"^ *{title}\n *-{{{len(title)}}}\n(.*?)(?=\n\n *\w[\w ]*\n *---|\Z)", text, re.M | re.S)
    return found[1] if found else ""


def described(text):
    """Names in the section of the parameters."""
    heads = re.findall(r"^ *([*\w][\w*, ]*?) *:|^ *(\*\*?\w+)$", section(text, "Parameters"), re.M)
    return {name.strip("* ") for names in heads for name in "".join(names).split(",")}


def functions(item):
    """A function itself; of a class its public methods."""
    if not isclass(item):
        return [item]
    methods = [method for key, method in getmembers(item, lambda m: isfunction(m) or ismethod(m)) if key[0] != "_"]
    return [
        method
        for method in methods
        if method.__module__.startswith("taichi_mps") and method.__qualname__.startswith(item.__name__)
    ]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_parameter_result_and_property_is_described(name):
    item = PUBLIC[name]
    assert section(item.__doc__, "Examples"), "no example"
    if isclass(item) and issubclass(item, Checked):
        bare = [
            key
            for key, field in item.model_fields.items()
            if field.annotation is not type(None) and not field.description
        ]
        assert not bare, "fields without a description"
    elif is_dataclass(item):
        assert {field.name for field in fields(item)} <= described(item.__doc__)
    for function in functions(item):
        text = function.__doc__ or ""
        taken = {key for key, p in signature(function).parameters.items() if key not in ("self", "cls")}
        assert taken <= described(text) or isclass(item) and issubclass(item, Checked), function.__qualname__
        untyped = [key for key, p in signature(function).parameters.items() if p.annotation is Parameter.empty]
        gives = signature(function).return_annotation
        annotated = gives is not Parameter.empty and set(untyped) <= {"self", "cls"}
        assert annotated or function.__name__ in OF_KERNELS, (
            f"{function.__qualname__}: no type of {untyped or 'result'}"
        )
        if gives is not Parameter.empty and gives not in NO_RESULT:
            assert section(text, "Returns") or section(text, "Yields"), function.__qualname__
    for key, value in vars(item).items() if isclass(item) else ():
        if isinstance(value, property) and key[0] != "_":
            assert re.match(r"[A-Z].*\.", value.__doc__ or ""), key


@pytest.mark.parametrize("module", [module for module in MODULES if module not in COMPILING])
def test_examples_run(module):
    found = doctest.testmod(import_module(f"taichi_mps.{module}"))
    assert found.attempted and not found.failed


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(COMPILING))
def test_examples_that_compile_kernels_run(module):
    """Each example runs in its own process, since it starts Taichi."""
    result = child(
        "-c", f"import doctest, taichi_mps.{module} as m; print(doctest.testmod(m, optionflags=doctest.ELLIPSIS))"
    )
    assert re.search(r"failed=0, attempted=[1-9]", result.stdout), result.stdout + result.stderr
