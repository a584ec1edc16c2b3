"""The palette live: what is wanted of its cells, designs beside the window, wizards."""
