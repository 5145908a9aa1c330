"""A recorded flight flown again, compared to the last bit."""

from groundstation.analysis.replay import command as command
