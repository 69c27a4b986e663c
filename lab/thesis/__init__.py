"""The thesis' search experiment (section 4.4): its building, its 18 searches, its Table 4.5."""
