"""Machine files of a design on beds and sheets, with manifest and page."""
