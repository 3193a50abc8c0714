"""Figures: what is drawn, each with the numbers it draws, and its files. The only user of matplotlib."""
