"""``python -m validation``: runs the validation table, or some of its rows, from the root of a checkout."""

import argparse
import json
import sys

from taichi_mps.engine.problem.numerics import NUMERICS
from taichi_mps.io.run_folder import strict
from taichi_mps.units import SceneError, user_path

from .table import run_table

DONE, TARGET_MISSED, BAD_INPUT = 0, 1, 2  # exit codes


def main(words=None) -> int:
    """Run the rows of a command line, and print the table of all that are kept: DONE, TARGET_MISSED (also where a row
    failed) or BAD_INPUT."""
    about = "Run cases with a known answer; ends with 1 where a target is missed or a row fails."
    parser = argparse.ArgumentParser("python -m validation", description=about)
    parser.add_argument("rows", nargs="*", help="names of rows; all by default")
    parser.add_argument("--quick", action="store_true", help="only the rows of a few seconds")
    parser.add_argument("--scheme", choices=NUMERICS, default="implicit", help="with its defaults [implicit]")
    parser.add_argument("--budget", help="CPU time [s] after which a row is stopped")
    parser.add_argument("--out", default="renders/validation", help="folder for table.md and a JSON file a row")
    parser.add_argument("--page", help="Markdown page with the marks of the table, to write it into")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    given = parser.parse_args(words)
    try:
        text, results = run_table(given.rows, given.quick, user_path(given.out), given.page, given.scheme, given.budget)
    except (SceneError, OSError) as error:
        print(f"validation: {error}", file=sys.stderr)
        return BAD_INPUT
    print(json.dumps(strict(results)) if given.json else text)
    failed = any(result["error"] and not result["error"].startswith("not run") for result in results)
    missed = not all(item["met"] for result in results for item in result["numbers"])
    return TARGET_MISSED if failed or missed else DONE


if __name__ == "__main__":
    sys.exit(main())
