"""Optional packages: the command that installs what an extra brings into this very environment."""

DISTRIBUTION = "quadrotor-groundstation"
"""Name of the installed package."""


def describe_install(extra: str) -> str:
    """Return the command that installs ``extra`` from where this program came: a clone, a file or
    an index.
    """
    # Rarely needed, and slow to load: every program would wait for these.
    import json
    import shlex
    import sys
    from importlib.metadata import PackageNotFoundError, distribution
    from pathlib import Path
    from urllib.parse import unquote, urlsplit

    try:
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        sources = Path(__file__).parents[2]  # it runs from its sources, without being installed
        origin = {"url": sources.as_uri(), "dir_info": {"editable": True}}
    url = urlsplit(origin.get("url", ""))
    what = unquote(url.path) if url.scheme == "file" else DISTRIBUTION
    words = [sys.executable, "-m", "pip", "install"]
    words += ["-e"] if origin.get("dir_info", {}).get("editable") else []
    return shlex.join([*words, f"{what}[{extra}]"])
