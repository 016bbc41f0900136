//! Queries: which are asked, when, and with what for company.

use super::{Command, Culler, Proxy, QueryId, SETTLED};
use crate::adaptive::Mode;
use crate::hierarchy::Hierarchy;
use crate::policy::Policy;
use farsight_geometry::bvh::NodeId;

impl Culler {
    pub(super) fn issue<H: Hierarchy + ?Sized>(
        &mut self,
        hierarchy: &H,
        nodes: &[u32],
        must_resolve: bool,
        geometry: bool,
    ) -> u32 {
        let (slot, serial) = self.slots.issue(self.frame, must_resolve, nodes);
        for &node in nodes {
            self.nodes[node as usize].slot = slot;
        }
        let view = self.view.expect("a frame has begun");
        let proxy_of = |node: u32| view.proxy(&hierarchy.bounds(NodeId(node)), self.options.inflate_px);
        let proxy = match nodes {
            _ if geometry => Proxy::Geometry,
            [node] => Proxy::Box(proxy_of(*node)),
            _ => {
                self.boxes.clear();
                self.boxes.extend(nodes.iter().map(|&n| proxy_of(n)));
                Proxy::Boxes
            }
        };
        self.stats.queries += 1;
        self.stats.must_resolve += u64::from(must_resolve);
        self.stats.shared += u64::from(nodes.len() > 1);
        self.awaited += u32::from(must_resolve);
        self.issued_since_flush = true;
        let id = QueryId { slot, serial };
        self.out.push_back(Command::Query { id, node: NodeId(nodes[0]), proxy, must_resolve });
        slot
    }

    pub(super) fn ask_about_leaf<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H, node: u32) {
        let culling = self.switch.mode() == Mode::Culling;
        let slot =
            self.issue(hierarchy, &[node], culling && !self.options.defer && !self.is_bounded(), false);
        self.deferred.push(slot);
    }

    pub(super) fn is_bounded(&self) -> bool {
        self.options.policy != Policy::Exact
    }

    /// Issues queries that waited for the end of the wave. One shared query at a time, as its boxes are handed out with it.
    pub(super) fn issue_waiting<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) -> bool {
        if !self.hidden.is_empty() {
            self.issue_hidden(hierarchy);
            return true;
        }
        let any = !self.leaves.is_empty();
        let mut leaves = std::mem::take(&mut self.leaves);
        for node in leaves.drain(..) {
            self.ask_about_leaf(hierarchy, node);
        }
        self.leaves = leaves;
        any
    }

    /// One query for the last of the hidden nodes, and for others that are as settled.
    pub(super) fn issue_hidden<H: Hierarchy + ?Sized>(&mut self, hierarchy: &H) {
        let most = self.options.nodes_per_query as usize;
        let settled = |s: &Self, node: u32| s.nodes[node as usize].hidden_streak >= SETTLED;
        let mut group = std::mem::take(&mut self.scratch);
        group.clear();
        while let Some(&node) = self.hidden.last() {
            let fits = group.is_empty() || (settled(self, node) && settled(self, group[0]));
            if group.len() >= most || !fits {
                break;
            }
            group.push(node);
            self.hidden.pop();
        }
        self.issue(hierarchy, &group, !self.is_bounded(), false);
        self.scratch = group;
    }
}
