"""Newton, judge, revise, until no bound breaks: written once, and handed a method."""
