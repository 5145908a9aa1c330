"""Text of the simulator for people: its own sentences, beside those of the ground station."""

from sim.text.sim_notices import SIM_NOTICES, notice
