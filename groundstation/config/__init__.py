"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.config.loader import (
        CLIENT_LETTERS,
        FACTORY,
        NAME,
        VEHICLE_LETTERS,
        ArgumentError,
        ConfigError,
        FromFile,
        OpenFactory,
        Option,
        Problem,
        UserCodeFault,
        call_factory,
        complete,
        copy_examples,
        coroutine_hint,
        describe_name,
        describe_pattern,
        describe_type,
        dotted_key,
        dump,
        example_text,
        example_texts,
        field_notes,
        find_object,
        from_dict,
        is_name,
        is_within_bounds,
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
        refuse_io,
        resolve_files,
        several,
        shipped_texts,
        strip_metadata,
        structs,
        texts_of,
        without_frames,
        write_value,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
