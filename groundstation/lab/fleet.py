"""Fleet plan: a file names the configuration that all vehicles share, and for each what differs
from it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec

from groundstation.config import WHOLE_NAME, ConfigError, from_dict, read_toml, resolve_files
from groundstation.core.messages import notice
from groundstation.pose import PoseConfig
from groundstation.settings import Config, rehearse
from links.io import parse_address

Name = Annotated[str, msgspec.Meta(pattern=WHOLE_NAME)]


class FleetFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contents of a fleet file, but for the sections of each vehicle."""

    config: Annotated[
        str,
        msgspec.Meta(
            description="The configuration that all vehicles share; relative to the fleet file."
        ),
    ]
    relay_port: Annotated[
        int,
        msgspec.Meta(
            ge=1024,
            le=65000,
            description="Loopback UDP port to which the first vehicle's copy of the poses goes; "
            "the others' follow it.",
        ),
    ] = 51101
    vehicles: Annotated[
        tuple[dict[str, Any], ...],
        msgspec.Meta(
            min_length=1,
            description="For each its `name`, its `object` in the capture system where that is "
            "another, and what else differs.",
        ),
    ]


class _Who(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    name: Name
    object: str | None = None


class Member(NamedTuple):
    """One vehicle of a fleet."""

    name: str
    lab: Config
    """As the files say it: its poses come from the lab's network."""
    core: Config
    """As its core runs it: its poses may come from the relay."""


class FleetPlan(NamedTuple):
    """All of it."""

    members: tuple[Member, ...]
    relay_listen: str | None
    """Where poses to be handed on come in, host:port; None where each core hears the source."""

    @property
    def relay_targets(self) -> tuple[str, ...]:
        """Where they are handed on to, host:port, one for each vehicle."""
        return tuple(member.core.pose.address for member in self.members)


def read_fleet(path: Path, overrides: Sequence[str] = (), *, rehearsed: bool = False) -> FleetPlan:
    """The fleet in the TOML file ``path``; ``overrides`` (``a.b=value``) are for every vehicle.

    ``rehearsed``: with every address turned to the loopback network, see
        :mod:`groundstation.settings.settings`.

    Raises:
        ConfigError: by file, vehicle and key; also where two vehicles would use the same name,
            object or port.
    """
    data = read_toml(path)
    if data and not {"config", "vehicles"} & data.keys():
        raise ConfigError("config", notice("fleet.no_file"), str(path))
    file = from_dict(data, FleetFile, source=str(path))
    shared = path.parent / file.config
    common = read_toml(shared)
    whos = [_who(entry, number, path) for number, entry in enumerate(file.vehicles)]
    _ensure_unlike("name", [(who.name, who.name) for who in whos], path)
    _ensure_unlike("object", [(who.name, who.object or who.name) for who in whos], path)
    labs = []
    for who, entry in zip(whos, file.vehicles, strict=True):
        rest = {key: value for key, value in entry.items() if key not in ("name", "object")}
        others = [one.object or one.name for one in whos if one is not who]
        labs.append(_member(who, rest, others, common, overrides, path, shared))
    _ensure_apart(whos, labs, file.relay_port, path)
    relayed = labs[0].pose.is_relayed
    members = [
        Member(who.name, lab, _behind_relay(lab, file.relay_port + number) if relayed else lab)
        for number, (who, lab) in enumerate(zip(whos, labs, strict=True))
    ]
    if rehearsed:
        turned = [
            [rehearse(one, path, fleet=True) for one in (member.lab, member.core)]
            for member in members
        ]
        members = [Member(lab.vehicle.name, lab, core) for lab, core in turned]
        _ensure_unlike(
            "name", [(who.name, one.name) for who, one in zip(whos, members, strict=True)], path
        )
        labs = [member.lab for member in members]
    return FleetPlan(tuple(members), labs[0].pose.address if relayed else None)


def _who(entry: dict[str, Any], number: int, path: Path) -> _Who:
    known: dict[str, Any] = {key: entry[key] for key in ("name", "object") if key in entry}
    try:
        return from_dict(known, _Who, source=str(path))
    except ConfigError as error:
        raise ConfigError(f"vehicles[{number}].{error.key}", error.problem, str(path)) from None


def _member(
    who: _Who,
    entry: dict[str, Any],
    others: list[str],
    common: dict[str, Any],
    overrides: Sequence[str],
    path: Path,
    shared: Path,
) -> Config:
    data = _merge(common, entry)
    pose = data.get("pose", {})
    kind = pose.get("kind", "vicon") if isinstance(pose, dict) else "vicon"
    kinds = {one.__struct_config__.tag: one for one in PoseConfig.__args__ if one.shows_others}
    if kind not in kinds:
        raise ConfigError(
            "pose.kind", notice("fleet.pose_kind", choices=list(kinds), found=kind), str(shared)
        )
    for section, told in (
        ("vehicle", {"name": who.name}),
        ("pose", {kinds[kind].body_key: who.object or who.name}),
        ("separation", {"others": others}),
    ):
        if isinstance(table := data.get(section, {}), dict):  # anything else is refused below
            data[section] = table | told
    try:
        placed = resolve_files(data, shared.parent)
        return from_dict(placed, Config, overrides, source=str(shared), folder=shared.parent)
    except ConfigError as error:
        source = (
            f"{path}: vehicle {who.name}"
            if _has(entry, error.key)
            else f"{error.source} (for {who.name})"
        )
        raise ConfigError(error.key, error.problem, source) from None


def _merge(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """``common`` with what ``own`` changes, table by table.

    One of another ``kind`` takes the place of the whole.
    """
    merged = dict(common)
    for key, value in own.items():
        old = common.get(key)
        same = (
            isinstance(old, dict)
            and isinstance(value, dict)
            and value.get("kind", old.get("kind")) == old.get("kind")
        )
        merged[key] = _merge(old, value) if same and isinstance(old, dict) else value
    return merged


def _has(entry: Any, key: str) -> bool:
    for part in key.split("."):
        if not isinstance(entry, dict):
            return True
        if part not in entry:
            return False
        entry = entry[part]
    return bool(key)


def _behind_relay(config: Config, port: int) -> Config:
    behind: dict[str, Any] = {config.pose.address_key: f"127.0.0.1:{port}"}
    return msgspec.structs.replace(config, pose=msgspec.structs.replace(config.pose, **behind))


def _ensure_unlike(key: str, named: Sequence[tuple[str, str | None]], path: Path) -> None:
    """No two vehicles have the same value of ``key``."""
    first: dict[str, str] = {}
    for name, value in named:
        if value is not None and (other := first.setdefault(value, name)) is not name:
            raise ConfigError(
                key, notice("fleet.taken", value=value, other=other), f"{path}: vehicle {name}"
            )


def _ensure_apart(whos: list[_Who], labs: list[Config], relay_port: int, path: Path) -> None:
    """No two vehicles share a link or a socket, and all hear the same source."""
    names = [who.name for who in whos]
    for key in ("listen", "serial", "port"):
        _ensure_unlike(
            f"link.{key}", [(n, _end(lab, key)) for n, lab in zip(names, labs, strict=True)], path
        )
    for key in (
        "remote",
        "tcp",
    ):  # several may be behind one address: they have their own system ids
        ends = [lab.link.destination if lab.link.address_key == key else None for lab in labs]
        _ensure_unlike(f"link.{key}", list(zip(names, ends, strict=True)), path)
    _ensure_unlike(
        "status.path",
        [(n, lab.status.path or None) for n, lab in zip(names, labs, strict=True)],
        path,
    )
    for name, lab in zip(names, labs, strict=True):
        if lab.pose.stream != labs[0].pose.stream:
            raise ConfigError(
                "pose", notice("fleet.other_source", other=names[0]), f"{path}: vehicle {name}"
            )
        port = _end(lab, "listen")
        if lab.pose.is_relayed:
            taken = range(relay_port, relay_port + len(labs))
            poses_port = parse_address(lab.pose.address)[1]
            if poses_port in taken:
                says = notice(
                    "fleet.relay_ports", first=taken[0], last=taken[-1], address=lab.pose.address
                )
                raise ConfigError("relay_port", says, str(path))
            if port is not None and int(port) in (*taken, poses_port):
                raise ConfigError(
                    "link.listen", notice("fleet.port", port=port), f"{path}: vehicle {name}"
                )


def _end(config: Config, key: str) -> str | None:
    """Where the link of ``config`` ends, if ``key`` says so.

    Of an address of this machine only the port counts.
    """
    link = config.link
    if link.address_key != key:
        return None
    return str(parse_address(link.endpoint)[1]) if key == "listen" else link.endpoint
