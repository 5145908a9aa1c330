"""Sentences of the commands of a terminal, about their arguments and what these ask for. Sans-IO."""

from links.text import NoticeTemplate

COMMAND_NOTICES: tuple[NoticeTemplate, ...] = (
    # Spellings of an older release.
    NoticeTemplate("command.moved", "`{old}` is now `{new}`", "the old spelling works for one more release"),
    NoticeTemplate(
        "command.scenario_option",
        "--scenario {name} is now {name} alone",
        "the old spelling works for one more release",
    ),
)
