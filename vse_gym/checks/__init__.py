"""Conformance checks, a file for each kind of block; :mod:`vse_gym.testing` is their public face."""
