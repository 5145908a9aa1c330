"""``groundstation mqtt``: keys of clients, topics and schemas."""

import argparse
import sys

from groundstation.config import ConfigError

EXIT_DONE = 0


def mqtt_command(args: argparse.Namespace) -> int:
    """Do what the verb says.

    Raises:
        ConfigError: a file can't be written.
    """
    try:
        {"make-key": _make_key, "topics": _topics, "schemas": _schemas}[args.verb](args)
    except (OSError, ValueError) as error:
        raise ConfigError(f"mqtt {args.verb}", str(error)) from None
    return EXIT_DONE


def _make_key(args: argparse.Namespace) -> None:
    from links.io import make_key

    make_key(args.file)
    print(
        f"{args.file}: a new key, for your eyes only. Copy it to the client by a safe way, mode 0600, and name it "
        "as key_file of mqtt.requests.clients.NAME",
        file=sys.stderr,
    )


def _topics(args: argparse.Namespace) -> None:
    from groundstation.interfaces.mqtt.schemas import topics_table, write_topics

    if args.write is not None:
        write_topics(args.write)
    print(topics_table())


def _schemas(args: argparse.Namespace) -> None:
    import json

    from groundstation.interfaces.mqtt.schemas import schemas, write_schemas

    if args.write is None:
        print(json.dumps(schemas(), indent=2, ensure_ascii=False))
        return
    for path in write_schemas(args.write):
        print(path)
