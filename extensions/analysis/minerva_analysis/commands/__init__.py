"""The commands with their options, by topic; what they do is imported when they are called."""
