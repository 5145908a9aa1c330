"""The pages of the dashboard."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.tui.pages.control_page import ControlPage
    from groundstation.interfaces.tui.pages.fly_page import FlyPage
    from groundstation.interfaces.tui.pages.links_page import LinksPage
    from groundstation.interfaces.tui.pages.page import PAGES, Frame, Page
    from groundstation.interfaces.tui.pages.text_pages import ConfigPage, LogPage

_MODULES = {
    "control_page": ("ControlPage",),
    "fly_page": ("FlyPage",),
    "links_page": ("LinksPage",),
    "page": ("Frame", "PAGES", "Page"),
    "text_pages": ("ConfigPage", "LogPage"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
