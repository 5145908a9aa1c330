"""Three sets of colours, told apart by colour-blind eyes: Okabe and Ito's (jfly.uni-koeln.de/color), adapted to paper.

A style in the texts of the other files is a name from here, such as ``$flown``. Meaning never rests on colour alone.
"""

from textual.theme import Theme

LABEL, NORMAL, WARNING = "$label", "", "bold $warn"
FLOWN, WANTED, ERROR, WIND = "$flown", "$wanted", "$mark", "$wind"
AXES = ("$axis-1", "$axis-2", "$axis-3")
"""Of three numbers that are drawn together."""


def _theme(name: str, *, dark: bool, background: str, text: str, **colours: str) -> Theme:
    return Theme(
        name=name,
        primary=colours["flown"],
        secondary=colours["wind"],
        warning=colours["warn"],
        error=colours["bad"],
        success=colours["wind"],
        accent=colours["warn"],
        foreground=text,
        background=background,
        surface=colours["raised"],
        panel=colours["raised"],
        dark=dark,
        variables={
            "block-cursor-background": colours["flown"],
            "block-cursor-foreground": background,
            **{key.replace("_", "-"): colour for key, colour in colours.items()},
        },
    )


THEMES = (
    _theme(
        "dark",
        dark=True,
        background="#101214",
        text="#E8E8E8",
        raised="#202428",
        label="#9AA0A6",
        flown="#56B4E9",
        wanted="#B0B0B0",
        mark="#F0E442",
        wind="#00B386",
        warn="#E69F00",
        bad="#FF7A33",
        axis_1="#56B4E9",
        axis_2="#E69F00",
        axis_3="#CC79A7",
        alarm_text="#FFFFFF",
        alarm_back="#A03000",
        alarm_dim="#381808",
        busy_text="#000000",
        busy_back="#E69F00",
        calm_text="#FFFFFF",
        calm_back="#444444",
        flying_text="#FFFFFF",
        flying_back="#005A9C",
    ),
    _theme(
        "light",
        dark=False,
        background="#FFFFFF",
        text="#101010",
        raised="#E6E8EA",
        label="#5A5F64",
        flown="#0067A5",
        wanted="#808080",
        mark="#7A6A00",
        wind="#00755A",
        warn="#9A5B00",
        bad="#B34100",
        axis_1="#0067A5",
        axis_2="#9A5B00",
        axis_3="#9B3D75",
        alarm_text="#FFFFFF",
        alarm_back="#B33A00",
        alarm_dim="#FFE3D6",
        busy_text="#000000",
        busy_back="#F0B030",
        calm_text="#000000",
        calm_back="#C8CCD0",
        flying_text="#FFFFFF",
        flying_back="#0067A5",
    ),
    _theme(
        "contrast",
        dark=True,
        background="#000000",
        text="#FFFFFF",
        raised="#000000",
        label="#FFFFFF",
        flown="#5CC8FF",
        wanted="#FFFFFF",
        mark="#FFF25C",
        wind="#2CFFC6",
        warn="#FFB000",
        bad="#FF8040",
        axis_1="#5CC8FF",
        axis_2="#FFB000",
        axis_3="#FF9AD5",
        alarm_text="#000000",
        alarm_back="#FF8040",
        alarm_dim="#000000",
        busy_text="#000000",
        busy_back="#FFF25C",
        calm_text="#000000",
        calm_back="#FFFFFF",
        flying_text="#000000",
        flying_back="#5CC8FF",
    ),
)
"""The first is the usual one."""
