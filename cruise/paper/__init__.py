"""The publication redone: its experiments, its tables and what its text states of its figures, beside ours."""
