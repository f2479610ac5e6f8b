"""Architecture: who may import whom, read from the source with ast; and an import of the package that is instant.

The rule: a module imports only modules of a lower layer; inside one layer only what PEERS names. So the terms of
layer 2 do not know each other, except that what is made of stress shares the constitutive law (rheology). Whatever is
not in LAYERS is an edge (files, pictures, command line): it may read everything, and nothing below may import it.
"""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taichi_mps"
EDGE = 4
LAYERS = {
    0: "quantity material bodies geometry solids inner_edges measure rest_shapes inlet filling report scene admission",
    1: "backend stages team weights ghosts surfaces friction particles neighbors gradient mrpcg sparse grid_levels "
    "scales smoothing node_grids conjugate_gradient grid_operators rows",
    2: "rheology stress walls wall_layer viscosity pressure momentum deferred_correction shifting totals sleeping "
    "evening free_momentum pouring rest snapshots summary",
    3: "schemes.implicit schemes.semi_implicit simulation",
}
PEERS = {
    "material": {"quantity"},
    "bodies": {"quantity"},
    "geometry": {"quantity", "material", "bodies"},
    "solids": {"quantity", "material", "geometry", "inner_edges"},
    "rest_shapes": {"quantity"},
    "inlet": {"quantity", "material"},
    "filling": {"quantity"},
    "scene": {"quantity", "material", "geometry", "solids", "measure", "inlet", "filling"},
    "admission": {"quantity", "material", "geometry", "inlet", "solids", "scene"},
    "stages": {"backend"},
    "team": {"backend", "stages"},
    "weights": {"backend"},
    "surfaces": {"backend"},
    "ghosts": {"backend", "weights"},
    "friction": {"backend"},
    "rows": {"backend"},
    "particles": {"backend", "rows", "stages"},
    "neighbors": {"backend", "stages"},
    "gradient": {"backend", "rows", "stages", "particles", "weights"},
    "mrpcg": {"backend", "stages", "team", "conjugate_gradient", "sparse", "grid_levels"},
    "conjugate_gradient": {"backend"},
    "grid_levels": {"backend", "grid_operators", "team"},
    "grid_operators": {"backend", "node_grids"},
    "node_grids": {"backend"},
    "sparse": {"backend", "team"},
    "scales": {"backend"},
    "smoothing": {"backend", "stages"},
    "viscosity": {"rheology"},
    "stress": {"rheology"},
    "wall_layer": {"rheology"},
    "momentum": {"rheology", "sleeping"},
    "simulation": {"schemes.implicit", "schemes.semi_implicit"},
}
LAYER = {name: layer for layer, names in LAYERS.items() for name in names.split()}


def module_name(path):
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts)


MODULES = {module_name(p): ast.parse(p.read_text(encoding="utf-8")) for p in sorted(PACKAGE.rglob("*.py"))}
PLAIN = [name for name in MODULES if not name.endswith(("__init__", "__main__")) and not name.startswith("scenes.")]


def imports(name, tree):
    """Modules of the package that a module imports, anywhere in its text."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = name.split(".")[: -node.level]
            target = ".".join([*base, *(node.module.split(".") if node.module else [])])
            found |= {target} if target in MODULES else {f"{target}.{a.name}".lstrip(".") for a in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("taichi_mps"):
            found.add(node.module.removeprefix("taichi_mps").lstrip("."))
    return {item for item in found if item in MODULES}


def top_level(tree):
    """Nodes that run at import: everything outside function bodies."""
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            waiting.extend(ast.iter_child_nodes(node))


@pytest.mark.parametrize("name", PLAIN)
def test_imports_only_from_lower_layers(name):
    layer = LAYER.get(name, EDGE)
    for other in imports(name, MODULES[name]):
        below = LAYER.get(other, EDGE) < layer
        peer = other in PEERS.get(name, set()) or layer == EDGE
        assert below or peer, f"{name} (layer {layer}) imports {other} (layer {LAYER.get(other, EDGE)})"


def test_every_layered_module_and_peer_exists():
    assert set(LAYER) <= set(MODULES)
    for name, peers in PEERS.items():
        used = imports(name, MODULES[name])
        assert peers <= used, f"{name} no longer imports {peers - used}: take it out of PEERS"


def test_no_import_circles():
    graph = {name: imports(name, MODULES[name]) for name in PLAIN}
    assert list(TopologicalSorter(graph).static_order())  # CycleError names the circle


def test_the_package_itself_names_only_layer_0_at_import():
    for node in MODULES["__init__"].body:
        if isinstance(node, ast.ImportFrom) and node.level:
            names = [node.module] if node.module else [a.name for a in node.names]
            assert all(LAYER.get(item) == 0 for item in names), names


@pytest.mark.parametrize("name", [*MODULES, *(f"../scenes/{p.name}" for p in sorted((ROOT / "scenes").glob("*.py")))])
def test_only_the_backend_imports_taichi(name):
    tree = MODULES[name] if name in MODULES else ast.parse((PACKAGE / name).read_text(encoding="utf-8"))
    names = [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
    names += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level]
    uses_taichi = any(item.split(".")[0] == "taichi" for item in names)
    assert uses_taichi == (name == "backend")


@pytest.mark.parametrize("name", list(MODULES))
def test_taichi_is_never_started_at_import(name):
    calls = {ast.unparse(node.func) for node in top_level(MODULES[name]) if isinstance(node, ast.Call)}
    assert not calls & {"ti.init", "init", "backend.init"}
    everywhere = {ast.unparse(node.func) for node in ast.walk(MODULES[name]) if isinstance(node, ast.Call)}
    assert ("ti.init" in everywhere) == (name == "backend")


@pytest.mark.parametrize("name", [name for name in PLAIN if "backend" in imports(name, MODULES[name])])
def test_no_postponed_annotations_where_kernels_live(name):
    """`from __future__ import annotations` makes every kernel argument a string: TaichiSyntaxError."""
    futures = [n for n in ast.walk(MODULES[name]) if isinstance(n, ast.ImportFrom) and n.module == "__future__"]
    assert not futures


def test_import_is_instant():
    code = (
        "import sys, taichi_mps; from taichi_mps import catalogue; [catalogue.load(n) for n in catalogue.names()];"
        "print(sorted({'taichi', 'h5py', 'matplotlib', 'meshio', 'imageio'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
