"""What stands out: every candidate screened beside what was found, the best refitted, round by round."""
