"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.config.examples import copy_examples, example_names, example_text, list_examples
    from groundstation.config.files import beside, presets, toml
    from groundstation.config.loader import ConfigError, dump, from_dict, load
    from groundstation.config.names import CLIENT_LETTERS, NAME, VEHICLE_LETTERS, a_name, in_words, is_name, name_of
    from groundstation.config.schema import FromFile, Open, Problem, completed, dotted, keys_of, structs
    from groundstation.config.text import docs
    from groundstation.config.words import expected

_MODULES = {
    "examples": ("copy_examples", "example_names", "example_text", "list_examples"),
    "files": ("beside", "presets", "toml"),
    "loader": ("ConfigError", "dump", "from_dict", "load"),
    "names": ("CLIENT_LETTERS", "NAME", "VEHICLE_LETTERS", "a_name", "in_words", "is_name", "name_of"),
    "schema": ("FromFile", "Open", "Problem", "completed", "dotted", "keys_of", "structs"),
    "text": ("docs",),
    "words": ("expected",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
