"""report.html: one page about a result that needs nothing but itself."""
