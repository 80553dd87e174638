"""The workbench looked at from outside: served by its verb, seen in a real browser."""
