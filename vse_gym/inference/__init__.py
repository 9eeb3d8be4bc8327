"""Estimation as pure compiled functions, generic over the model (see :mod:`vse_gym.inference.model`)."""
