"""What a command is given, a name or a file, made into a mechanism that moves."""
