"""OpenFOAM's interFoam (volume of fluid, Herschel-Bulkley law) on the slump cone as an axisymmetric wedge.

    python benchmarks/peers/openfoam_slump.py install       # apt-get install openfoam (Debian 12: version 1912)

Run by compare.py as `python openfoam_slump.py CASE.json OUT.npz`. A wedge of 5 degrees, square cells of the case's
spacing, no slip on the floor, open above and outside. Courant number 0.5; schemes and solvers of the damBreak tutorial,
but a momentumPredictor (it makes the viscous term implicit) with PBiCGStab, which halves the cost of its smoother. The
law caps the viscosity at (tau_y/rate + eta)/rho: below that shear rate the material creeps. The surface of a column of
cells is where alpha = 0.5; slump is the mean over r < 20 mm, spread that of the row of cells that reaches farthest.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

RADIUS, TOP, HALF_ANGLE = 0.3, 0.36, np.deg2rad(2.5)  # of the domain [m], of the wedge

HEAD = "FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"

MESH = """
scale 1;
vertices ((0 0 0) ({x} -{y} 0) ({x} {y} 0) (0 0 {h}) ({x} -{y} {h}) ({x} {y} {h}));
blocks (hex (0 1 2 0 3 4 5 3) ({nr} 1 {nz}) simpleGrading (1 1 1));
edges ();
boundary (
  floor {{ type wall; faces ((0 1 2 0)); }}
  air {{ type patch; faces ((3 4 5 3) (1 2 5 4)); }}
  front {{ type wedge; faces ((0 1 4 3)); }}
  back {{ type wedge; faces ((0 3 5 2)); }}
  axis {{ type empty; faces ((0 3 3 0)); }}
);
mergePatchPairs ();
"""
VELOCITY = """
dimensions [0 1 -1 0 0 0 0]; internalField uniform (0 0 0);
boundaryField {{ floor {{ type noSlip; }} air {{ type pressureInletOutletVelocity; value uniform (0 0 0); }}
  front {{ type wedge; }} back {{ type wedge; }} axis {{ type empty; }} }}
"""
PRESSURE = """
dimensions [1 -1 -2 0 0 0 0]; internalField uniform 0;
boundaryField {{ floor {{ type fixedFluxPressure; value uniform 0; }} air {{ type totalPressure; p0 uniform 0; }}
  front {{ type wedge; }} back {{ type wedge; }} axis {{ type empty; }} }}
"""
ALPHA = """
dimensions [0 0 0 0 0 0 0]; internalField nonuniform List<scalar> {n}
({values});
boundaryField {{ floor {{ type zeroGradient; }} air {{ type inletOutlet; inletValue uniform 0; value uniform 0; }}
  front {{ type wedge; }} back {{ type wedge; }} axis {{ type empty; }} }}
"""
TRANSPORT = """
phases (concrete air);
concrete {{ transportModel HerschelBulkley; rho {rho};
  HerschelBulkleyCoeffs {{ nu0 {nu0}; tau0 {tau0}; k {k}; n 1; }} }}
air {{ transportModel Newtonian; nu 1.48e-05; rho 1; }}
sigma 0;
"""
CONTROL = """
application interFoam; startFrom startTime; startTime 0; stopAt endTime; endTime {until}; deltaT 1e-4;
writeControl adjustableRunTime; writeInterval 0.1; purgeWrite 0; writeFormat ascii; writePrecision 8;
timeFormat general; timePrecision 6; runTimeModifiable no; adjustTimeStep yes;
maxCo {courant}; maxAlphaCo {courant}; maxDeltaT {max_dt};
"""
SCHEMES = """
ddtSchemes {{ default Euler; }} gradSchemes {{ default Gauss linear; }}
divSchemes {{ div(rhoPhi,U) Gauss linearUpwind grad(U); div(phi,alpha) Gauss vanLeer; div(phirb,alpha) Gauss linear;
  div(((rho*nuEff)*dev2(T(grad(U))))) Gauss linear; }}
laplacianSchemes {{ default Gauss linear corrected; }} interpolationSchemes {{ default linear; }}
snGradSchemes {{ default corrected; }}
"""
SOLUTION = """
solvers {{
  "alpha.concrete.*" {{ nAlphaCorr 2; nAlphaSubCycles 1; cAlpha 1; MULESCorr yes; nLimiterIter 5;
    solver smoothSolver; smoother symGaussSeidel; tolerance 1e-8; relTol 0; }}
  "pcorr.*" {{ solver PCG; preconditioner DIC; tolerance 1e-5; relTol 0; }}
  p_rgh {{ solver PCG; preconditioner DIC; tolerance 1e-07; relTol 0.05; }}
  p_rghFinal {{ $p_rgh; relTol 0; }}
  "U.*" {{ solver {momentum}; tolerance 1e-06; relTol 0; }}
}}
PIMPLE {{ momentumPredictor yes; nOuterCorrectors {outer}; nCorrectors 3; nNonOrthogonalCorrectors 0; }}
"""
SMOOTHER, KRYLOV = "smoothSolver; smoother symGaussSeidel", "PBiCGStab; preconditioner DILU"


def filled(case: dict, nr: int, nz: int) -> np.ndarray:
    """Share of each cell inside the cone (nz, nr), by 20 x 20 points weighted with their radius."""
    fine = 20
    r = (np.arange(nr * fine) + 0.5) * RADIUS / (nr * fine)
    z = (np.arange(nz * fine) + 0.5) * TOP / (nz * fine)
    edge = case["base_radius"] + (case["top_radius"] - case["base_radius"]) * z / case["height"]
    inside = (r < edge[:, None]) & (z < case["height"])[:, None]
    weight = np.broadcast_to(r, inside.shape)

    def summed(field):
        return field.reshape(nz, fine, nr, fine).sum((1, 3))

    return summed(inside * weight) / summed(weight)


def write(case: dict, folder: Path) -> tuple[int, int]:
    """The case's files; the number of cells along r and z."""
    settings, rho = case["settings"], case["density"]
    nr, nz = round(RADIUS / case["spacing"]), round(TOP / case["spacing"])
    alpha = filled(case, nr, nz)
    reach = RADIUS / np.cos(HALF_ANGLE)
    files = {
        "system/blockMeshDict": (
            "dictionary",
            MESH.format(x=reach * np.cos(HALF_ANGLE), y=reach * np.sin(HALF_ANGLE), h=TOP, nr=nr, nz=nz),
        ),
        "system/controlDict": (
            "dictionary",
            CONTROL.format(until=case["until"], courant=settings["courant"], max_dt=settings.get("max_dt", 0.01)),
        ),
        "system/fvSchemes": ("dictionary", SCHEMES.format()),
        "system/fvSolution": (
            "dictionary",
            SOLUTION.format(outer=settings.get("outer", 1), momentum=KRYLOV if settings.get("krylov") else SMOOTHER),
        ),
        "constant/g": ("uniformDimensionedVectorField", "dimensions [0 1 -2 0 0 0 0]; value (0 0 -9.81);\n"),
        "constant/turbulenceProperties": ("dictionary", "simulationType laminar;\n"),
        "constant/transportProperties": (
            "dictionary",
            TRANSPORT.format(
                rho=rho,
                tau0=case["yield_value"] / rho,
                k=case["plastic_viscosity"] / rho,
                nu0=(case["yield_value"] / settings["rate"] + case["plastic_viscosity"]) / rho,
            ),
        ),
        "0/U": ("volVectorField", VELOCITY.format()),
        "0/p_rgh": ("volScalarField", PRESSURE.format()),
        "0/alpha.concrete": (
            "volScalarField",
            ALPHA.format(n=alpha.size, values="\n".join(f"{a:.6g}" for a in alpha.ravel())),
        ),
    }
    for path, (kind, text) in files.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(HEAD.format(kind=kind, name=target.name) + text, encoding="utf-8")
    return nr, nz


def read_alpha(text: str, nr: int, nz: int) -> np.ndarray:
    """Concrete's share of the cells (nz, nr) from the text of a field file."""
    body = re.search(r"internalField\s+nonuniform\s+List<scalar>\s*(\d+)\s*\(([^)]*)\)", text)
    values = np.array(body[2].split(), float)
    if len(values) != int(body[1]) or len(values) != nr * nz:
        raise ValueError(f"alpha has {len(values)} cells, the mesh {nr * nz}")
    return values.reshape(nz, nr)


def crossing(alpha: np.ndarray, cell: float) -> float:
    """Distance [m] along a line of cells at which alpha falls through 0.5 for the last time, or 0."""
    above = np.flatnonzero(alpha >= 0.5)
    if len(above) == 0:
        return 0.0
    last = above[-1]
    if last + 1 == len(alpha):
        return cell * len(alpha)
    part = (alpha[last] - 0.5) / (alpha[last] - alpha[last + 1])
    return float(cell * (last + 0.5 + part))


def measured(alpha: np.ndarray, cell: float, height: float, radius: float = 0.02) -> tuple[float, float]:
    """Slump (mean over r < radius, weighted with the area) and spread [m] of a body of that initial height [m]."""
    edges = np.minimum(np.arange(alpha.shape[1] + 1) * cell, radius)
    area = np.diff(edges**2)
    tops = np.array([crossing(column, cell) for column in alpha.T])
    return float(height - (area * tops).sum() / area.sum()), 2.0 * max(crossing(row, cell) for row in alpha)


def simulate(case: dict) -> dict:
    """Slump and spread [m] at the written times, and what interFoam cost."""
    environment = os.environ | {"WM_PROJECT_DIR": os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")}
    with tempfile.TemporaryDirectory(prefix="openfoam_") as name:
        folder = Path(name)
        nr, nz = write(case, folder)
        subprocess.run(["blockMesh"], cwd=folder, env=environment, stdout=subprocess.DEVNULL, check=True)
        with open(folder / "log", "w", encoding="utf-8") as log:
            child = subprocess.Popen(["interFoam"], cwd=folder, stdout=log, stderr=log, env=environment)
            _, status, usage = os.wait4(child.pid, 0)
        text = (folder / "log").read_text(encoding="utf-8")
        if status:
            raise RuntimeError(f"interFoam ended with status {status}:\n{text[-800:]}")
        cell = RADIUS / nr
        times = sorted((p for p in folder.iterdir() if re.fullmatch(r"[\d.]+", p.name)), key=lambda p: float(p.name))
        fields = [read_alpha((p / "alpha.concrete").read_text(encoding="utf-8"), nr, nz) for p in times]
    slumps = [measured(field, cell, case["height"]) for field in fields]
    r = (np.arange(nr) + 0.5) * cell
    volume = [float((field * r).sum()) for field in fields]
    return {
        "t": np.array([float(p.name) for p in times]),
        "slump": np.array([s for s, _ in slumps]),
        "spread": np.array([s for _, s in slumps]),
        "steps": len(re.findall(r"^Time = ", text, re.M)),
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
        "elements": nr * nz,
        "volume_error": max(abs(v / volume[0] - 1.0) for v in volume),
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["install"]:
        subprocess.run(["apt-get", "install", "-y", "--no-install-recommends", "openfoam"], check=True)
    else:
        np.savez(sys.argv[2], **simulate(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))))
