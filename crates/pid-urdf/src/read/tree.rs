//! Links and joints as one tree.

use super::reader::Reader;
use crate::description::{Joint, Link};
use crate::error::{TreeFault, UrdfError};

impl Reader<'_> {
    /// The root, and the joints from it outwards in the order of the file.
    pub(super) fn order(
        &self,
        links: &[Link],
        joints: &[Joint],
    ) -> Result<(usize, Vec<usize>), UrdfError> {
        let mut carrier: Vec<Option<usize>> = vec![None; links.len()];
        for (index, joint) in joints.iter().enumerate() {
            if let Some(first) = carrier[joint.child].replace(index) {
                return Err(UrdfError::TwoParents {
                    file: self.file.to_owned(),
                    line: joint.places.line,
                    link: links[joint.child].name.clone(),
                    joint: joint.name.clone(),
                    first: joints[first].name.clone(),
                });
            }
        }
        let mut roots = (0..links.len()).filter(|&l| carrier[l].is_none());
        let Some(root) = roots.next() else {
            let found = match links.first() {
                None => TreeFault::Empty,
                Some(link) => TreeFault::NoRoot {
                    link: link.name.clone(),
                },
            };
            return Err(self.tree(found));
        };
        if let Some(second) = roots.next() {
            return Err(self.tree(TreeFault::TwoRoots {
                first: links[root].name.clone(),
                second: links[second].name.clone(),
            }));
        }
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
        for (index, joint) in joints.iter().enumerate() {
            below[joint.parent].push(index);
        }
        let mut order = Vec::new();
        let mut stack: Vec<usize> = below[root].iter().rev().copied().collect();
        let mut reached = vec![false; links.len()];
        reached[root] = true;
        while let Some(joint) = stack.pop() {
            order.push(joint);
            let child = joints[joint].child;
            reached[child] = true;
            stack.extend(below[child].iter().rev());
        }
        match reached.iter().position(|reached| !reached) {
            None => Ok((root, order)),
            Some(link) => Err(self.tree(TreeFault::Loop {
                link: links[link].name.clone(),
                root: links[root].name.clone(),
            })),
        }
    }
}
