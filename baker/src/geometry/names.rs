//! Which names apply to a mesh or a lamp of a file: its own and those of every node above, nearest first.

/// Whether a name fits a pattern, `*` standing for any run of characters.
pub(crate) fn fits(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // The last star, and how much it swallows so far.
    let mut star = None;
    while n < name.len() {
        if pattern.get(p) == Some(&'*') {
            star = Some((p, n));
            p += 1;
        } else if pattern.get(p) == Some(&name[n]) {
            (p, n) = (p + 1, n + 1);
        } else if let Some((at, swallowed)) = star {
            star = Some((at, swallowed + 1));
            (p, n) = (at + 1, swallowed + 1);
        } else {
            return false;
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

/// The nodes of a file, every parent before its children; an OBJ has none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    pub nodes: Vec<TreeNode>,
}

/// A node of a file.
#[derive(Clone, Debug)]
pub(crate) struct TreeNode {
    /// Its index in the glTF.
    pub index: usize,
    /// Its name, or empty.
    pub name: String,
    /// Its parent's place in the tree.
    pub parent: Option<usize>,
    /// Whether the file says that it and what is below it moves.
    pub movable: Option<bool>,
}

/// The names that apply to something at a node.
pub(crate) struct Names<'a> {
    own: Vec<&'a str>,
    tree: &'a Tree,
    /// The node above those whose names are its own.
    above: Option<usize>,
}

impl Tree {
    /// A node and all above it, nearest first.
    pub(super) fn path(&self, node: Option<usize>) -> impl Iterator<Item = &TreeNode> {
        let at = move |node: usize| &self.nodes[node];
        std::iter::successors(node.map(at), move |node| node.parent.map(at))
    }

    /// What the file says of whether a node moves: it or the nearest node above that says anything.
    pub(super) fn movable(&self, node: Option<usize>) -> Option<bool> {
        self.path(node).find_map(|node| node.movable)
    }

    /// The names of something at a node, which are those of its own (empty ones aside) and of all nodes above
    /// `node`. Those of its own contain the node's.
    pub(super) fn names<'a>(
        &'a self,
        own: impl IntoIterator<Item = &'a str>,
        node: Option<usize>,
    ) -> Names<'a> {
        let mut kept: Vec<&str> = own.into_iter().filter(|name| !name.is_empty()).collect();
        kept.dedup();
        Names { own: kept, tree: self, above: node.and_then(|node| self.nodes[node].parent) }
    }

    /// The names of a mesh at a node: of its material, node and mesh, and of every node above.
    pub(super) fn names_at<'a>(&'a self, node: Option<usize>, material: &'a str, mesh: &'a str) -> Names<'a> {
        let at = node.map_or("", |node| self.nodes[node].name.as_str());
        self.names([material, at, mesh], node)
    }

    /// The names of a node by itself.
    pub(super) fn names_of_node(&self, node: usize) -> Names<'_> {
        self.names([self.nodes[node].name.as_str()], Some(node))
    }
}

impl<'a> Names<'a> {
    /// All of them, nearest first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &'a str> {
        let above = self.tree.path(self.above).map(|node| node.name.as_str());
        self.own.iter().copied().chain(above.filter(|name| !name.is_empty()))
    }

    /// The nearest one.
    pub(crate) fn first(&self) -> Option<&'a str> {
        self.iter().next()
    }

    /// Whether one of them fits a pattern.
    pub(crate) fn fit(&self, pattern: &str) -> bool {
        self.iter().any(|name| fits(pattern, name))
    }
}

#[cfg(test)]
mod tests {
    use super::fits;

    #[test]
    fn stars_stand_for_any_run() {
        for (pattern, name, expected) in [
            ("leaf", "leaf", true),
            ("leaf", "leaf.001", false),
            ("leaf*", "leaf.001", true),
            ("*leaf", "oak_leaf", true),
            ("*a*b*", "xxaxxbxx", true),
            ("*a*b", "ab_ab_a", false),
            ("a*a", "a", false),
            ("*", "", true),
            ("**", "x", true),
            ("", "x", false),
        ] {
            assert_eq!(fits(pattern, name), expected, "{pattern} {name}");
        }
    }
}
