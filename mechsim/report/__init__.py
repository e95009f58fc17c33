"""Reports of mechanisms and studies, as HTML pages and in notebooks."""
