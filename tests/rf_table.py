"""The byte table of the serial RF modules, shared by tests of reader, writer and fuzz."""

import json
import pathlib
from typing import NamedTuple

from links.rf import CrsfLinkConfig, DsmLinkConfig, Service
from links.rf.codec import RfCodec, position


class Row(NamedTuple):
    """A frame, what it says, and the codec that writes it."""

    about: str
    frame: bytes
    codec: RfCodec
    positions: tuple[float, ...] | None
    service: Service | None
    model_id: int | None


def _load() -> list[Row]:
    table = json.loads((pathlib.Path(__file__).parent / "golden" / "rf_frames.json").read_text())
    rows = []
    for r in table["dsm"]:
        codec = DsmLinkConfig(protocol=r["protocol"], model_id=r["model_id"]).codec()
        positions = tuple(position(count, 96, 928) for count in r["counts"])
        service = Service(r["service"]) if r["service"] else None
        rows.append(
            Row(r["about"], bytes.fromhex(r["hex"]), codec, positions, service, r["model_id"])
        )
    for r in table["crsf"]:
        codec_ = CrsfLinkConfig(address=r["address"]).codec()
        positions = tuple(position(count, 172, 1811) for count in r["counts"])
        rows.append(Row(r["about"], bytes.fromhex(r["hex"]), codec_, positions, None, None))
    for r in table["crsf_orders"]:
        codec_ = CrsfLinkConfig(model_id=r["model_id"]).codec()
        service = Service(r["service"]) if r["service"] else None
        rows.append(Row(r["about"], bytes.fromhex(r["hex"]), codec_, None, service, r["model_id"]))
    return rows


ROWS = _load()
CODECS: dict[str, RfCodec] = {"dsm": DsmLinkConfig().codec(), "crsf": CrsfLinkConfig().codec()}
"""One of each kind, with its default settings."""


def of_kind(kind: str) -> list[Row]:
    """The rows that a codec of ``kind`` reads."""
    return [row for row in ROWS if type(row.codec) is type(CODECS[kind])]
