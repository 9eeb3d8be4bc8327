"""Standard tests: the driver and the course, and how a drive is judged."""
