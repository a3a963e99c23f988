"""The paper's figures again: what they show, their page, and how they are made."""
