"""Significant candidates: each is screened beside what was found, the best are refitted, round by round."""
