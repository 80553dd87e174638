"""Every figure that the project claims, measured: one part a file, one table of parts in __main__."""
