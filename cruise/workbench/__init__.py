"""The web page: one view a file, fed by the functions of the command line; it decides and computes nothing itself."""
