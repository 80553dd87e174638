"""Does a test notice when its subject is broken? The subject is broken in every way that a tool knows."""
