"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.config.loader import (
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
        copy_examples,
        describe_name,
        describe_pattern,
        describe_type,
        dotted_key,
        dump,
        example_names,
        example_text,
        field_notes,
        find_object,
        from_dict,
        is_name,
        keys_of,
        lend,
        list_examples,
        load,
        locate,
        name_object,
        name_pattern,
        needed_names,
        parse_toml,
        presets,
        read_toml,
        resolve_files,
        several,
        structs,
        texts_of,
        without_frames,
        write_value,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
