"""Optional packages: the command that installs what an extra brings into this very environment."""

import json
import shlex
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

DISTRIBUTION = "quadrotor-groundstation"
"""Name of the installed package."""
SOURCES = Path(__file__).parents[2]
"""Folder of the sources, where the package runs from them without being installed."""


def describe_install(extra: str) -> str:
    """Return the command that installs ``extra`` from where this program came: a clone, a file or an index."""
    from importlib.metadata import PackageNotFoundError, distribution  # slow, and rarely needed

    try:
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        origin = {"url": SOURCES.as_uri(), "dir_info": {"editable": True}}
    url = urlsplit(origin.get("url", ""))
    what = unquote(url.path) if url.scheme == "file" else DISTRIBUTION
    words = [sys.executable, "-m", "pip", "install"]
    words += ["-e"] if origin.get("dir_info", {}).get("editable") else []
    return shlex.join([*words, f"{what}[{extra}]"])
