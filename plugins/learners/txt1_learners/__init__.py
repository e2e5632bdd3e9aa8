"""Learners that txt1 finds by their entry points (`txt1.learning.registry`)."""
