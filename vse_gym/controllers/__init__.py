"""Stability controllers: what the estimate is for."""
