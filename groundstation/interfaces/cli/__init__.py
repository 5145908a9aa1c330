"""The commands of `groundstation`."""

from groundstation.interfaces.cli.commands import advise_name, completion_script, words_of_flying
