"""A kernel with CAN for every machine: the one at hand, or Debian's in a virtual machine that sees the same files."""
