//! Compounding against closed forms.
