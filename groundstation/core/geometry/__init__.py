"""Elementary functions, rotations and frames, for floats and arrays of vehicles."""
