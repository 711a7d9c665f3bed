"""Random machines over all that the library describes, and checks that need no other code. See `scripts/campaign.py`."""
