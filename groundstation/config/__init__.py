"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.config.loader import (
        copy_examples,
        dump,
        example_names,
        example_text,
        field_notes,
        from_dict,
        list_examples,
        load,
        parse_toml,
        presets,
        read_toml,
        resolve_files,
    )
    from groundstation.config.schema import (
        CLIENT_LETTERS,
        FACTORY,
        NAME,
        VEHICLE_LETTERS,
        ConfigError,
        FromFile,
        OpenFactory,
        Option,
        Problem,
        UserCodeFault,
        call_factory,
        complete,
        describe_name,
        describe_pattern,
        describe_type,
        dotted_key,
        find_object,
        is_name,
        keys_of,
        lend,
        locate,
        name_object,
        name_pattern,
        needed_names,
        structs,
        texts_of,
    )

_MODULES = {
    "loader": (
        "copy_examples",
        "dump",
        "example_names",
        "example_text",
        "field_notes",
        "from_dict",
        "list_examples",
        "load",
        "parse_toml",
        "presets",
        "read_toml",
        "resolve_files",
    ),
    "schema": (
        "CLIENT_LETTERS",
        "ConfigError",
        "FACTORY",
        "FromFile",
        "NAME",
        "OpenFactory",
        "Option",
        "Problem",
        "UserCodeFault",
        "VEHICLE_LETTERS",
        "call_factory",
        "complete",
        "describe_name",
        "describe_pattern",
        "describe_type",
        "dotted_key",
        "find_object",
        "is_name",
        "keys_of",
        "lend",
        "locate",
        "name_object",
        "name_pattern",
        "needed_names",
        "structs",
        "texts_of",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
