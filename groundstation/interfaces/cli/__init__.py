"""The commands of `groundstation`."""

from groundstation.interfaces.cli.commands import completion_script, words_of_flying
