"""The whole configuration of a ground station: one section a struct."""
