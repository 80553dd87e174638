"""Models against measurements: how good, how good at best, where they fail, and what they lack."""
