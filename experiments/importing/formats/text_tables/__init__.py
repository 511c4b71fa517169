"""Tables of text: separators, decimals, headers, clocks."""
