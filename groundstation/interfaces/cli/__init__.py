"""The commands of `groundstation`."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.cli.commands import completion_script, words_of_flying


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
