"""Tools by which language-model agents ask a map: Model Context Protocol over stdio or HTTP."""
