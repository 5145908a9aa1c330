"""Our controller: the backstepping law, its certificate, and how a vehicle is brought down."""
