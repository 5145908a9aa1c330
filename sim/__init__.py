"""Everything simulated: worlds, autopilots, trackers and radios, and the runs and studies that are made of them."""
