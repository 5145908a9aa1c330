"""Many flights at once: the same law, estimator and plant on arrays of vehicles."""

from sim.batch.batch import Flights, fly_batch, require_batchable, zeros
