"""Questions put to many flights: campaigns, comparisons, tuning, margins."""

from sim.studies.budget import Contribution
from sim.studies.comparison import (
    CONTROLLERS,
    Case,
    ComparedFlight,
    cases,
    compare,
    markdown_table,
    rows,
    text_table,
    write_between_markers,
)
from sim.studies.equal_margins import (
    FLOORED,
    FLOORS,
    SEARCHED_LAWS,
    TRIALS,
    ModelError,
    compare_at_equal_margins,
    describe_terms,
    equal_margins_table,
)
from sim.studies.intervals import coverage_table, identify_flights
from sim.studies.upsets import BATCHES, VEHICLES, compare_upsets, upsets_table
from sim.studies.vectors import LIMIT, worst_disagreement
