"""One view a file: a function that shows what the session holds and hands its buttons to the session."""
