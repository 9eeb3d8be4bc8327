"""State estimators: tunings, and which rule of :mod:`vse_gym.inference` they use."""
