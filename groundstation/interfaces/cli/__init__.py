"""The commands of `groundstation`."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.cli.completion import completion_script, words_of_flying
    from groundstation.interfaces.cli.program import add_completion, build_parser, path

_MODULES = {
    "completion": ("completion_script", "words_of_flying"),
    "program": ("add_completion", "build_parser", "path"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
