"""Sentences of the commands of a terminal: refused arguments, and refused files. Sans-IO."""

from links.text import NoticeTemplate

COMMAND_NOTICES: tuple[NoticeTemplate, ...] = (
    # Spellings of an older release.
    NoticeTemplate(
        "command.moved", "`{old}` is now `{new}`", "the old spelling works for one more release"
    ),
    # Requests to a flight.
    NoticeTemplate("request.not_one", "expected such as Request(Ask.LAND), got {found!r}"),
    NoticeTemplate("request.no_words", "takes nothing behind it, got {found!r}"),
    NoticeTemplate(
        "request.waypoint", "{name}: expected a number from {least:g} to {most:g}, got {found!r}"
    ),
    NoticeTemplate(
        "request.only_goto", "points: expected 1 to {most} with goto, and none with anything else"
    ),
    NoticeTemplate("request.points", "expected at most {most} points, got {count}"),
    NoticeTemplate("goto.numbers", "expected NORTH EAST DOWN [YAW], got {count} numbers"),
    NoticeTemplate("goto.words", "expected NORTH EAST DOWN [YAW] in numbers, got {found!r}"),
    NoticeTemplate("follow.one_file", "expected one FILE.csv, got {count} words"),
    NoticeTemplate("follow.point", "{path}: point {number}: {why}"),
    # Radio modules and their bridge.
    NoticeTemplate(
        "radio.link_kind", "expected one of {choices}: no other link has a radio module here"
    ),
    # MQTT.
    NoticeTemplate(
        "mqtt.url", "expected mqtts://[USER@]HOST[:PORT][/PREFIX], or mqtt:// on this machine"
    ),
    NoticeTemplate(
        "mqtt.unencrypted",
        "{host} is another machine, and nothing would be encrypted",
        "write mqtts://",
    ),
    NoticeTemplate("mqtt.missing_option", "missing; --mqtt needs --vehicle, --client and --key"),
    NoticeTemplate("mqtt.same_key", "{path} holds another client's key: each needs its own"),
    # Fleets.
    NoticeTemplate(
        "fleet.is_one",
        "this is a fleet file",
        "`groundstation fleet` flies it; its --show NAME prints the configuration of one vehicle",
    ),
    NoticeTemplate(
        "fleet.no_file",
        "this is no fleet file: one names the configuration that all vehicles share, config = "
        '"lab.toml", and has [[vehicles]]; is it that configuration itself?',
    ),
    NoticeTemplate(
        "fleet.pose_kind",
        "expected one of {choices}, got {found!r}: a vehicle of a fleet must see the others",
    ),
    NoticeTemplate("fleet.taken", "{value!r} is {other}'s already"),
    NoticeTemplate("fleet.other_source", "must be the same source as {other}'s"),
    NoticeTemplate("fleet.relay_ports", "{first} to {last} take pose.listen, {address}"),
    NoticeTemplate("fleet.port", "port {port} is taken by the poses"),
    # Rehearsals.
    NoticeTemplate(
        "rehearse.unknown_key",
        "this key may hold an address, and --rehearse has no rule for it",
        "add it to ADDRESSES or TEXTS in groundstation/settings/settings.py",
    ),
    NoticeTemplate(
        "rehearse.same_address",
        "becomes {address} in a rehearsal, as link.listen does",
        "rehearse with --set of another port",
    ),
    NoticeTemplate(
        "rehearse.unserved",
        "nobody plays the other side of {file}; start it: groundstation-sim serve --config {file}",
    ),
    NoticeTemplate(
        "rehearse.no_terminal",
        "{path} is no pseudo-terminal",
        "remove it, and start it: groundstation-sim serve --config {file}",
    ),
)
