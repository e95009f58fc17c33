"""Suites of others: their cases, solved by mechsim and compared with their printed answers."""
