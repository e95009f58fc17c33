"""How far each axis can be changed before something breaks: see docs/explanation/extremes.md."""
