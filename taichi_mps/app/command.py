"""The command app of the command line."""

import re

from pydantic import Field

from ..cli.options import DONE, command, given
from ..units import Checked, plain, require, require_package

PORT = 8100


class App(Checked):
    """Options of app."""

    port: int = Field(PORT, ge=0, le=65535, description="port of this machine, 0 for any that is free")
    folder: str = Field("renders", description="folder of the runs")
    token: str | None = Field(None, description="what the address must hold, by default drawn anew; '' lets all in")


@command(
    "A page in the browser of this machine: set up, watch and compare runs.",
    {"--no-browser": {"action": "store_true", "help": "do not open the browser"}},
    {App: ("output",)},
)
def app(arguments) -> int:
    """a page in the browser to set up, watch and compare runs"""
    options = App(**given(arguments, App))
    require(
        re.fullmatch(r"[A-Za-z0-9._~-]*", options.token or ""),
        f"token = {plain(options.token)}: must be of letters, digits and . _ ~ -, as an address holds them",
    )
    for name in ("starlette", "uvicorn"):
        require_package(name, "app needs", "app")
    from .server import serve

    serve(options.port, options.folder, not arguments.no_browser, options.token)
    return DONE
