"""Sentences about keys of a link's configuration whose values do not go together, and about addresses. Sans-IO."""

from links.text.sentence import NoticeTemplate

KEY_NOTICES: tuple[NoticeTemplate, ...] = (
    NoticeTemplate(
        "address.none",
        "{found!r} is not an address: {why}; write host:port such as 127.0.0.1:14550 or [::1]:14550",
    ),
    NoticeTemplate("address.no_port", "it has no port"),
    NoticeTemplate("address.no_host", "it has no host"),
    NoticeTemplate("address.no_brackets", "an IPv6 host needs brackets"),
    NoticeTemplate("address.brackets", "only an IPv6 host takes brackets"),
    NoticeTemplate("address.character", "the host holds a character that no host name has"),
    NoticeTemplate("address.port", "the port must be a whole number from 1 to 65535"),
    NoticeTemplate("mavlink.exclusive", "{keys} exclude each other: leave only one of them"),
    NoticeTemplate(
        "mavlink.local_port", "local_port is the port from which `remote` is spoken to: give remote, or leave it out"
    ),
    NoticeTemplate(
        "mavlink.no_estimate",
        "bring_down = 'land' needs a position estimate on board, and ardupilot_mode = 'GUIDED_NOGPS' says that there "
        "is none: leave out one of them",
    ),
    NoticeTemplate(
        "mavlink.forward_rate",
        "forward.rate_hz: {rate_hz:g} poses a second are {bytes_s:.0f} bytes a second, too much beside commands at "
        "baud = {baud}: lower the rate, or use a faster port",
    ),
    NoticeTemplate("rf.no_travel", "low and high are the same: the throttle would not move"),
    NoticeTemplate("rf.reversed", "low must be smaller than high; reverse single channels in the map"),
    NoticeTemplate("rf.never_disarms", "armed and disarmed are the same: it could never disarm"),
    NoticeTemplate("rf.channel_twice", "channel {channel} is given to two things: give each its own"),
    NoticeTemplate("rf.few_channels", "map names channel {channel}, but these frames carry {count} channels"),
    NoticeTemplate(
        "rf.long_frame",
        "a frame of {bytes} bytes takes {frame_ms:.2f} ms at {baud} baud, too long for a period of {period_ms:g} ms",
    ),
    NoticeTemplate("rf.lead", "lead_s must be shorter than period_s"),
    NoticeTemplate("rf.betaflight_channels", "Betaflight takes thrust and rates from channels 1 to 8"),
    # Parameters of an autopilot.
    NoticeTemplate("parameter.no_value", "{found} is no value for a parameter"),
    NoticeTemplate("parameter.whole_number", "expected a whole number from {least} to {most}, got {found:g}"),
)
