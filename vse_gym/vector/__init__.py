"""Many drives side by side: a native vector environment, for Gymnasium and for stable-baselines3."""
