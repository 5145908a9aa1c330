"""Pages of docs/reference that are made from the code: ``groundstation-sim reference --write docs/reference``."""

from collections.abc import Callable
from pathlib import Path

from groundstation.config.load import ConfigError
from groundstation.interfaces.mqtt.schemas import write_schemas
from tests.proving.reference import campaign_columns, channels, configuration, programs

PAGES: dict[str, Callable[[], str]] = {
    "configuration.md": configuration.page,
    "commands.md": programs.page,
    "recording-channels.md": channels.page,
    "campaign-columns.md": campaign_columns.page,
}
"""File → what is in it."""

SCHEMAS = "mqtt-schemas"
"""Folder of the JSON Schemas, beside the pages."""
MADE = "<!-- made by `groundstation-sim reference --write docs/reference`: change the code, not this page -->\n\n"


def page(name: str) -> str:
    """The whole text of that page."""
    return MADE + PAGES[name]().rstrip() + "\n"


def reference_command(folder: Path | None) -> str:
    """Write all pages and schemas into ``folder``, or return the pages as one text.

    Raises:
        ConfigError: a page can't be written.
    """
    if folder is None:
        return "\n".join(page(name) for name in PAGES)
    for name in PAGES:
        try:
            (folder / name).write_text(page(name), "utf-8")
        except OSError as error:
            raise ConfigError("--write", f"cannot write {folder / name}: {error.strerror}") from None
    written = [folder / name for name in PAGES] + write_schemas(folder / SCHEMAS)
    return "\n".join(f"{path} written" for path in written)
