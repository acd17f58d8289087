"""How long a training step takes, beside another library and beside what the machine could do at best."""
