//! Warnings of a reader, one line for each kind.

/// Warnings for the user, one for each kind: its first place, how many more, and how many items it concerns.
#[derive(Default)]
pub(super) struct Warnings {
    kinds: Vec<Warning>,
}

impl Warnings {
    pub(super) fn add(&mut self, message: impl Into<String>) {
        self.kinds.push(Warning { message: message.into(), place: None, places: 0, items: 0 });
    }

    pub(super) fn add_at(&mut self, place: &str, message: &str) {
        self.add_items(place, 0, message);
    }

    /// Adds a warning whose `message` continues a number, the sum of `items` over all places.
    pub(super) fn add_items(&mut self, place: &str, items: usize, message: &str) {
        if let Some(known) = self.kinds.iter_mut().find(|known| known.place.is_some() && known.message == message) {
            known.places += 1;
            known.items += items;
        } else {
            self.kinds.push(Warning { message: message.to_owned(), place: Some(place.to_owned()), places: 1, items });
        }
    }

    /// Takes back a warning: what it says is done after all.
    pub(super) fn retract(&mut self, message: &str) {
        self.kinds.retain(|known| known.message != message);
    }

    pub(super) fn into_lines(self) -> Vec<String> {
        self.kinds.into_iter().map(Warning::into_line).collect()
    }
}

struct Warning {
    message: String,
    place: Option<String>,
    places: usize,
    items: usize,
}

impl Warning {
    fn into_line(self) -> String {
        let Self { message, place, places, items } = self;
        let message = if items > 0 { format!("{items} {message}") } else { message };
        match (place, places) {
            (None, _) => message,
            (Some(place), 1) => format!("{place}: {message}"),
            (Some(place), _) => format!("{place} and {} more: {message}", places - 1),
        }
    }
}
