"""The picture of each scene: a short run with its defaults, and the last frame of it.

python benchmarks/gallery.py             # docs/figures/scenes/*.png, of all scenes, some CPU-minutes
python benchmarks/gallery.py film u_box  # of some
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PICTURES, WIDTH = ROOT / "docs/figures/scenes", 800  # [px]
SHOWN = {  # scene: the time that is shown [s], other options
    "slump": (0.25, "--yield-value 500 --model quarter"),
    "mini_cone": (0.5, ""),
    "flow_table": (1.3, "--model axisymmetric"),
    "j_ring": (1.5, ""),
    "l_flow": (0.5, ""),
    "l_box": (0.6, ""),
    "u_box": (0.35, ""),
    "lcpc_box": (1.0, ""),
    "v_funnel": (1.5, ""),
    "wall": (1.5, ""),
    "vane": (0.375, "--view speed"),
    "printing": (9.2, "--model path --layers 5"),
    "film": (0.5, "--view speed"),
    "dam_break": (0.25, "--view speed"),
    "still_pool": (0.2, "--view pressure"),
}


def picture(scene: str) -> None:
    """Run a scene to the time that is shown, and keep its last frame."""
    time, options = SHOWN[scene]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / scene
        call = f"-m taichi_mps run {scene} --until {time} --every {time} --threads 1 --quiet {options} --out"
        subprocess.run([sys.executable, *call.split(), out], cwd=ROOT, check=True)
        frame = Image.open(max((out / "frames").glob("*.png"))).convert("RGB")
    PICTURES.mkdir(parents=True, exist_ok=True)
    frame.resize((WIDTH, WIDTH * frame.height // frame.width)).save(PICTURES / f"{scene}.png", optimize=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or SHOWN:
        picture(name)
