"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""
