"""What the pages of the dashboard are made of."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.tui.parts.bars import TALL, Banner, Knobs, Tabs, content
    from groundstation.interfaces.tui.parts.dialogs import Choice, Dialog, Help, Typed
    from groundstation.interfaces.tui.parts.feed import Answer, Feed, Hello, Holder, Jump, News, Trouble
    from groundstation.interfaces.tui.parts.gain_table import Gain, gains
    from groundstation.interfaces.tui.parts.headline import ALARM, BUSY, CALM, FLYING, SILENCE_S
    from groundstation.interfaces.tui.parts.letters import big
    from groundstation.interfaces.tui.parts.orders import BY_ASK, ORDERS, Order, Twice, possible
    from groundstation.interfaces.tui.parts.panels import (
        Curves,
        ErrorHistory,
        Events,
        Horizon,
        InTime,
        Numbers,
        Preflight,
        TopView,
        event,
    )
    from groundstation.interfaces.tui.parts.picture import KEPT, Picture
    from groundstation.interfaces.tui.parts.plot import Spans, bar
    from groundstation.interfaces.tui.parts.themes import AXES, ERROR, FLOWN, LABEL, THEMES, WARNING
    from groundstation.interfaces.tui.parts.words import battery, flight_time, row, three

_MODULES = {
    "bars": ("Banner", "Knobs", "TALL", "Tabs", "content"),
    "dialogs": ("Choice", "Dialog", "Help", "Typed"),
    "feed": ("Answer", "Feed", "Hello", "Holder", "Jump", "News", "Trouble"),
    "gain_table": ("Gain", "gains"),
    "headline": ("ALARM", "BUSY", "CALM", "FLYING", "SILENCE_S"),
    "letters": ("big",),
    "orders": ("BY_ASK", "ORDERS", "Order", "Twice", "possible"),
    "panels": ("Curves", "ErrorHistory", "Events", "Horizon", "InTime", "Numbers", "Preflight", "TopView", "event"),
    "picture": ("KEPT", "Picture"),
    "plot": ("Spans", "bar"),
    "themes": ("AXES", "ERROR", "FLOWN", "LABEL", "THEMES", "WARNING"),
    "words": ("battery", "flight_time", "row", "three"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
