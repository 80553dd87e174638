"""What was found, in words, figures and pictures: what the command line and the page both show."""
