"""Faults on the virtual bus: what reveals each of them, how soon, and what harm is done until then."""
