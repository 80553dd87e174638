"""The ARX structure with its effects, its predictions and its files."""
