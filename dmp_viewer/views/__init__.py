"""The widgets, one a file. They show what they are given and say what is wished; none knows the controller."""
