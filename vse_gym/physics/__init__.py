"""Vehicle dynamics as pure compiled functions. Axes: ISO 8855 (x forward, y left, z up); units: SI and radians."""
