(* Comparison principles for motions with switches: calculus of [evolves], real induction, exits through faces. *)
Require Import Reals List Lra Lia.
From Dobc Require Import Statement.
Import ListNotations.
Open Scope R_scope.

(* ---- Finite sums ---- *)

Lemma sum_ext n f g : (forall k, (k < n)%nat -> f k = g k) -> sum n f = sum n g.
Proof.
  induction n as [|n IH]; simpl; intros H; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H n) by lia. reflexivity.
Qed.

Lemma sum_add n f g : sum n (fun k => f k + g k) = sum n f + sum n g.
Proof. induction n as [|n IH]; simpl; [ring|]. rewrite IH; ring. Qed.

Lemma sum_sub n f g : sum n (fun k => f k - g k) = sum n f - sum n g.
Proof. induction n as [|n IH]; simpl; [ring|]. rewrite IH; ring. Qed.

Lemma sum_opp n f : sum n (fun k => - f k) = - sum n f.
Proof. induction n as [|n IH]; simpl; [ring|]. rewrite IH; ring. Qed.

Lemma sum_scale n c f : sum n (fun k => c * f k) = c * sum n f.
Proof. induction n as [|n IH]; simpl; [ring|]. rewrite IH; ring. Qed.

Lemma sum_scale_r n c f : sum n (fun k => f k * c) = sum n f * c.
Proof. induction n as [|n IH]; simpl; [ring|]. rewrite IH; ring. Qed.

Lemma sum_zero n f : (forall k, (k < n)%nat -> f k = 0) -> sum n f = 0.
Proof.
  induction n as [|n IH]; simpl; intros H; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H n) by lia. ring.
Qed.

Lemma sum_swap n m f : sum n (fun i => sum m (fun j => f i j)) = sum m (fun j => sum n (fun i => f i j)).
Proof.
  induction n as [|n IH]; simpl.
  - symmetry; apply sum_zero; reflexivity.
  - rewrite IH, <- sum_add. reflexivity.
Qed.

Lemma sum_le n f g : (forall k, (k < n)%nat -> f k <= g k) -> sum n f <= sum n g.
Proof.
  induction n as [|n IH]; simpl; intros H; [lra|].
  assert (f n <= g n) by (apply H; lia).
  assert (sum n f <= sum n g) by (apply IH; intros; apply H; lia). lra.
Qed.

Lemma sum_nonneg n f : (forall k, (k < n)%nat -> 0 <= f k) -> 0 <= sum n f.
Proof.
  intros H. rewrite <- (sum_zero n (fun _ => 0)) by reflexivity. apply sum_le; exact H.
Qed.

(* One term of a sum of nonnegative terms is at most the sum. *)
Lemma sum_term n f i : (forall k, (k < n)%nat -> 0 <= f k) -> (i < n)%nat -> f i <= sum n f.
Proof.
  induction n as [|n IH]; simpl; intros H Hi; [lia|].
  assert (0 <= sum n f) by (apply sum_nonneg; intros; apply H; lia).
  assert (0 <= f n) by (apply H; lia).
  destruct (Nat.eq_dec i n) as [->|Hn]; [lra|].
  assert (f i <= sum n f) by (apply IH; [intros; apply H|]; lia). lra.
Qed.

(* The term [c] taken out of a sum. *)
Lemma sum_split n f c : (c < n)%nat -> sum n f = f c + sum n (fun d => if Nat.eqb d c then 0 else f d).
Proof.
  induction n as [|n IH]; simpl; intros Hc; [lia|].
  destruct (Nat.eq_dec c n) as [->|Hn].
  - rewrite Nat.eqb_refl.
    rewrite (sum_ext n (fun d => if Nat.eqb d n then 0 else f d) f); [ring|].
    intros d Hd. destruct (Nat.eqb_spec d n); [lia|reflexivity].
  - rewrite IH by lia. destruct (Nat.eqb_spec n c); [lia|ring].
Qed.

Lemma sum_abs n f : Rabs (sum n f) <= sum n (fun k => Rabs (f k)).
Proof.
  induction n as [|n IH]; simpl; [rewrite Rabs_R0; lra|].
  eapply Rle_trans; [apply Rabs_triang|]. lra.
Qed.

(* ---- Calculus of right derivatives ---- *)

(* The derivative from the right is the library's limit of the difference quotient over s > t. *)
Lemma right_derivative_limit f t l :
  right_derivative f t l <-> limit1_in (fun s => (f s - f t) / (s - t)) (fun s => t < s) l t.
Proof.
  unfold right_derivative, limit1_in, limit_in; simpl; unfold R_dist; split; intros H eps Heps.
  - destruct (H (eps / 2)) as (d & Hd & Hb); [lra|].
    exists d; split; [lra|]. intros s (Hs & Hsd).
    rewrite Rabs_right in Hsd by lra.
    assert (Hq : Rabs ((f s - f t) / (s - t) - l) <= eps / 2) by (apply Hb; lra). lra.
  - destruct (H eps Heps) as (d & Hd & Hb).
    exists d; split; [exact Hd|]. intros s Hs. apply Rlt_le, Hb. split; [lra|].
    rewrite Rabs_right; lra.
Qed.

(* Limits only see the values on the domain. *)
Lemma limit_on_domain (f g : R -> R) (D : R -> Prop) l t :
  (forall s, D s -> f s = g s) -> limit1_in f D l t -> limit1_in g D l t.
Proof.
  unfold limit1_in, limit_in; simpl; intros E H eps Heps.
  destruct (H eps Heps) as (d & Hd & Hb). exists d; split; [exact Hd|].
  intros s (HD & Hs). rewrite <- E by exact HD. apply Hb; split; assumption.
Qed.

(* Equal functions have equal right derivatives. *)
Lemma right_derivative_eq (f g : R -> R) t l m :
  (forall s, f s = g s) -> l = m -> right_derivative f t l -> right_derivative g t m.
Proof.
  intros E <- H eps Heps. destruct (H eps Heps) as (d & Hd & Hb).
  exists d; split; [exact Hd|]. intros s Hs. rewrite <- !E. apply Hb, Hs.
Qed.

Lemma right_derivative_const c t : right_derivative (fun _ => c) t 0.
Proof.
  intros eps Heps. exists 1; split; [lra|]. intros s Hs.
  replace ((c - c) / (s - t) - 0) with 0 by (field; lra). rewrite Rabs_R0; lra.
Qed.

Lemma right_derivative_plus f g t l m :
  right_derivative f t l -> right_derivative g t m -> right_derivative (fun s => f s + g s) t (l + m).
Proof.
  rewrite !right_derivative_limit. intros Hf Hg.
  eapply limit_on_domain; [|exact (limit_plus _ _ _ _ _ _ Hf Hg)].
  intros s Hs; simpl; field; lra.
Qed.

(* A function with a right derivative is continuous from the right. *)
Lemma right_derivative_continuous f t l :
  right_derivative f t l -> limit1_in f (fun s => t < s) (f t) t.
Proof.
  rewrite right_derivative_limit. intros Hf.
  assert (Hx : limit1_in (fun s => s - t) (fun s => t < s) 0 t).
  { intros eps Heps. exists eps; split; [exact Heps|]. simpl; unfold R_dist.
    intros s (_ & Hs). replace (s - t - 0) with (s - t) by ring. exact Hs. }
  assert (Hc : limit1_in (fun _ => f t) (fun s => t < s) (f t) t)
    by exact (limit_free (fun _ => f t) _ t t).
  assert (H := limit_plus _ _ _ _ _ _ (limit_mul _ _ _ _ _ _ Hf Hx) Hc).
  replace (l * 0 + f t) with (f t) in H by ring.
  eapply limit_on_domain; [|exact H]. intros s Hs; simpl; field; lra.
Qed.

Lemma right_derivative_mult f g t l m :
  right_derivative f t l -> right_derivative g t m ->
  right_derivative (fun s => f s * g s) t (l * g t + f t * m).
Proof.
  intros Hf Hg. assert (Hc := right_derivative_continuous _ _ _ Hf).
  rewrite !right_derivative_limit in *.
  assert (Hk : limit1_in (fun _ => g t) (fun s => t < s) (g t) t)
    by exact (limit_free (fun _ => g t) _ t t).
  eapply limit_on_domain;
    [|exact (limit_plus _ _ _ _ _ _ (limit_mul _ _ _ _ _ _ Hf Hk) (limit_mul _ _ _ _ _ _ Hc Hg))].
  intros s Hs; simpl; field; lra.
Qed.

(* An ordinary derivative is a right derivative. *)
Lemma derivative_right_derivative f t l : derivable_pt_lim f t l -> right_derivative f t l.
Proof.
  intros H eps Heps. destruct (H eps Heps) as ((d & Hd) & Hb). simpl in Hb.
  exists d; split; [exact Hd|]. intros s Hs.
  assert (Hq : Rabs ((f (t + (s - t)) - f t) / (s - t) - l) < eps)
    by (apply Hb; [lra | rewrite Rabs_right; lra]).
  replace (t + (s - t)) with s in Hq by ring. lra.
Qed.

(* ---- Calculus of [evolves] ---- *)

Section Until.
Context {T : R}.
Local Notation evolves := (@evolves T).

Lemma evolves_eq f g f' g' :
  evolves f f' -> (forall t, f t = g t) -> (forall t, 0 <= t < T -> f' t = g' t) -> evolves g g'.
Proof.
  intros (Hr & Hc) E E'. split; intros t Ht.
  - apply (right_derivative_eq f g t (f' t)); auto.
  - apply (continuity_pt_locally_ext f g 1 t); [lra | auto | apply Hc, Ht].
Qed.

Lemma evolves_const c : evolves (fun _ => c) (fun _ => 0).
Proof.
  split; intros t Ht; [apply right_derivative_const|].
  apply continuity_pt_const. intros a b; reflexivity.
Qed.

Lemma evolves_plus f g f' g' :
  evolves f f' -> evolves g g' -> evolves (fun t => f t + g t) (fun t => f' t + g' t).
Proof.
  intros (Hf & Cf) (Hg & Cg). split; intros t Ht.
  - apply right_derivative_plus; auto.
  - apply (continuity_pt_plus f g); auto.
Qed.

Lemma evolves_mult f g f' g' :
  evolves f f' -> evolves g g' -> evolves (fun t => f t * g t) (fun t => f' t * g t + f t * g' t).
Proof.
  intros (Hf & Cf) (Hg & Cg). split; intros t Ht.
  - apply right_derivative_mult; auto.
  - apply (continuity_pt_mult f g); auto.
Qed.

Lemma evolves_scale c f f' : evolves f f' -> evolves (fun t => c * f t) (fun t => c * f' t).
Proof.
  intros H. eapply evolves_eq; [exact (evolves_mult _ _ _ _ (evolves_const c) H) | reflexivity |].
  intros t _; simpl; ring.
Qed.

Lemma evolves_opp f f' : evolves f f' -> evolves (fun t => - f t) (fun t => - f' t).
Proof.
  intros H. eapply evolves_eq; [exact (evolves_scale (-1) _ _ H) | |]; intros; simpl; ring.
Qed.

Lemma evolves_minus f g f' g' :
  evolves f f' -> evolves g g' -> evolves (fun t => f t - g t) (fun t => f' t - g' t).
Proof. intros Hf Hg. exact (evolves_plus _ _ _ _ Hf (evolves_opp _ _ Hg)). Qed.

Lemma evolves_sum n f f' :
  (forall k, (k < n)%nat -> evolves (f k) (f' k)) ->
  evolves (fun t => sum n (fun k => f k t)) (fun t => sum n (fun k => f' k t)).
Proof.
  induction n as [|n IH]; simpl; intros H; [apply evolves_const|].
  apply evolves_plus; [apply IH; intros; apply H | apply H]; lia.
Qed.

(* A function with an ordinary derivative everywhere. *)
Lemma evolves_derivative f f' : (forall t, derivable_pt_lim f t (f' t)) -> evolves f f'.
Proof.
  intros H. split; intros t _.
  - apply derivative_right_derivative, H.
  - apply derivable_continuous_pt. exists (f' t). apply H.
Qed.

(* Time itself, and exponentials. *)
Lemma evolves_time : evolves (fun t => t) (fun _ => 1).
Proof. apply evolves_derivative. intros t. apply derivable_pt_lim_id. Qed.

Lemma evolves_exp c : evolves (fun t => exp (c * t)) (fun t => c * exp (c * t)).
Proof.
  apply evolves_derivative. intros t.
  replace (c * exp (c * t)) with (exp (c * t) * (c * 1)) by ring.
  apply (derivable_pt_lim_comp (fun t => c * t) exp).
  - apply (derivable_pt_lim_scal (fun t => t)), derivable_pt_lim_id.
  - apply derivable_pt_lim_exp.
Qed.

Lemma evolves_exp_decay c : evolves (fun t => exp (- (c * t))) (fun t => - c * exp (- (c * t))).
Proof.
  eapply evolves_eq; [exact (evolves_exp (- c)) | |]; intros; simpl;
    replace (- c * t) with (- (c * t)) by ring; reflexivity.
Qed.

(* ---- Real induction ---- *)

(* A stable property that holds at 0, survives a little to the right of every time, and passes to the limit from
   the left, holds for all t >= 0. *)
Lemma real_induction (Q : R -> Prop) :
  (forall t, ~ ~ Q t -> Q t) -> Q 0 ->
  (forall t, 0 <= t -> Q t -> exists d, 0 < d /\ forall s, t < s < t + d -> Q s) ->
  (forall t, 0 < t -> (forall s, 0 <= s < t -> Q s) -> Q t) ->
  forall t, 0 <= t -> Q t.
Proof.
  intros stable start right left T1 HT.
  set (E := fun t => 0 <= t <= T1 /\ forall s, 0 <= s <= t -> Q s).
  assert (E0 : E 0). { split; [lra|]. intros s Hs. replace s with 0 by lra. exact start. }
  destruct (completeness E) as (c & upper & least).
  { exists T1. intros t (Ht & _); lra. }
  { exists 0; exact E0. }
  assert (c0 : 0 <= c) by exact (upper 0 E0).
  assert (cT : c <= T1) by (apply least; intros t (Ht & _); lra).
  assert (before : forall s, 0 <= s < c -> Q s).
  { intros s Hs. apply stable. intros N.
    assert (c <= s); [|lra]. apply least. intros t (Ht & HQ).
    destruct (Rle_or_lt t s) as [|L]; [assumption|].
    exfalso. apply N, HQ. lra. }
  assert (at_c : Q c).
  { destruct (Rle_lt_or_eq_dec 0 c c0) as [Hc|<-]; [apply left; assumption | exact start]. }
  destruct (Rle_lt_or_eq_dec c T1 cT) as [Hlt|<-]; [exfalso | exact at_c].
  destruct (right c c0 at_c) as (d & Hd & after).
  set (t := Rmin T1 (c + d / 2)).
  assert (Ht : c < t <= T1 /\ t < c + d) by (unfold t, Rmin; destruct (Rle_dec T1 (c + d / 2)); lra).
  assert (E t).
  { split; [lra|]. intros s Hs. destruct (Rlt_or_le c s); [apply after; lra|].
    destruct (Req_dec s c) as [->|]; [exact at_c | apply before; lra]. }
  assert (t <= c) by (apply upper; assumption). lra.
Qed.

(* ---- Exits through faces ---- *)

(* A function that is positive, or zero and rising, stays nonnegative for a little while. *)
Lemma rises f f' t :
  right_derivative f t f' -> 0 <= f t -> (f t = 0 -> 0 < f') ->
  exists d, 0 < d /\ forall s, t < s < t + d -> 0 <= f s.
Proof.
  intros Hf Hpos Hrise. destruct (Rle_lt_or_eq_dec 0 (f t) Hpos) as [Hp|Hz].
  - destruct (right_derivative_continuous _ _ _ Hf (f t) Hp) as (d & Hd & Hb).
    exists d; split; [exact Hd|]. intros s Hs. simpl in Hb; unfold R_dist in Hb.
    assert (Hq : Rabs (f s - f t) < f t) by (apply Hb; split; [lra | rewrite Rabs_right; lra]).
    apply Rabs_def2 in Hq. lra.
  - symmetry in Hz. specialize (Hrise Hz).
    destruct (Hf (f' / 2)) as (d & Hd & Hb); [lra|].
    exists d; split; [exact Hd|]. intros s Hs. specialize (Hb s Hs). rewrite Hz in Hb.
    assert (Hq : - (f' / 2) <= (f s - 0) / (s - t) - f').
    { revert Hb. unfold Rabs. destruct (Rcase_abs _); lra. }
    replace (f s) with ((f s - 0) / (s - t) * (s - t)) by (field; lra).
    apply Rmult_le_pos; lra.
Qed.

(* Nonnegative before t and continuous at t: nonnegative at t. *)
Lemma nonneg_limit f t :
  0 < t -> continuity_pt f t -> (forall s, 0 <= s < t -> 0 <= f s) -> 0 <= f t.
Proof.
  intros Ht Hc Hb. destruct (Rle_or_lt 0 (f t)) as [|Hn]; [assumption|exfalso].
  destruct (Hc (- f t)) as (d & Hd & Hq); [lra|]. simpl in Hq; unfold R_dist in Hq.
  set (s := Rmax 0 (t - d / 2)).
  assert (Hs : 0 <= s < t /\ t - d < s) by (unfold s, Rmax; destruct (Rle_dec 0 (t - d / 2)); lra).
  assert (Hf : Rabs (f s - f t) < - f t).
  { apply Hq. split; [split; [exact I | lra] | rewrite Rabs_left; lra]. }
  apply Rabs_def2 in Hf. specialize (Hb s ltac:(lra)). lra.
Qed.

(* Finitely many functions that start nonnegative, and each of which rises whenever it is zero while the others are
   nonnegative, stay nonnegative. *)
Lemma barrier {I : Type} (faces : list I) (f f' : I -> R -> R) :
  (forall k, In k faces -> evolves (f k) (f' k)) ->
  (forall k, In k faces -> 0 <= f k 0) ->
  (forall t, 0 <= t < T -> (forall j, In j faces -> 0 <= f j t) ->
     forall k, In k faces -> f k t = 0 -> 0 < f' k t) ->
  forall t, 0 <= t < T -> forall k, In k faces -> 0 <= f k t.
Proof.
  intros Hev Hstart Hrise t0 Ht0.
  apply (real_induction (fun t => t < T -> forall k, In k faces -> 0 <= f k t)); [| | | | apply Ht0 | apply Ht0].
  - intros t N L0 k Hk. apply Rnot_lt_le. intros L. apply N. intros H. specialize (H L0 k Hk). lra.
  - intros _. exact Hstart.
  - intros t Ht Hnow0.
    destruct (Rlt_or_le t T) as [HtT|HtT]; [|exists 1; split; [lra|]; intros; lra].
    assert (Hnow := Hnow0 HtT). clear Hnow0.
    enough (G : exists d, 0 < d /\ forall s, t < s < t + d -> forall k, In k faces -> 0 <= f k s)
      by (destruct G as (d & Hd & G); exists d; split; [exact Hd | intros s Hs _; exact (G s Hs)]).
    assert (Hone : forall k, In k faces -> exists d, 0 < d /\ forall s, t < s < t + d -> 0 <= f k s).
    { intros k Hk. apply (rises _ (f' k t)); [apply Hev; [assumption | lra] | apply Hnow; assumption | apply Hrise; [lra | assumption | assumption]]. }
    clear - Hone. induction faces as [|k faces IH].
    + exists 1; split; [lra|]. intros s _ k [].
    + destruct IH as (d & Hd & H); [intros; apply Hone; right; assumption|].
      destruct (Hone k) as (d' & Hd' & H'); [left; reflexivity|].
      exists (Rmin d d'); split; [apply Rmin_pos; assumption|].
      intros s Hs. assert (Hl := Rmin_l d d'). assert (Hr := Rmin_r d d').
      intros j [<-|Hj]; [apply H'; lra | apply H; [lra|assumption]].
  - intros t Ht Hb HtT k Hk. apply nonneg_limit; [exact Ht | apply Hev; [assumption | lra] |].
    intros s Hs. apply Hb; [assumption | lra | assumption].
Qed.

(* Functions with moving bounds, over any finite set of indices: if on every face of the box the motion is slower
   than the face, no function ever leaves. *)
Lemma never_leaves_list {I : Type} (indices : list I) (e g b b' : I -> R -> R) :
  (forall k, In k indices -> evolves (e k) (g k)) ->
  (forall k, In k indices -> evolves (b k) (b' k)) ->
  (forall k, In k indices -> Rabs (e k 0) <= b k 0) ->
  (forall t, 0 <= t < T -> (forall j, In j indices -> Rabs (e j t) <= b j t) ->
     forall k, In k indices ->
       (e k t = b k t -> g k t < b' k t) /\ (e k t = - b k t -> - b' k t < g k t)) ->
  forall t, 0 <= t < T -> forall k, In k indices -> Rabs (e k t) <= b k t.
Proof.
  intros He Hb H0 Hface t Ht k Hk.
  set (faces := list_prod indices [true; false]).
  set (f := fun (x : I * bool) t => if snd x then b (fst x) t - e (fst x) t else b (fst x) t + e (fst x) t).
  set (f' := fun (x : I * bool) t => if snd x then b' (fst x) t - g (fst x) t else b' (fst x) t + g (fst x) t).
  assert (Hin : forall j s, In j indices -> In (j, s) faces).
  { intros j s Hj. apply in_prod; [exact Hj | destruct s; simpl; auto]. }
  assert (Hout : forall j s, In (j, s) faces -> In j indices).
  { intros j s Hj. apply in_prod_iff in Hj. apply Hj. }
  assert (Habs : forall u w, 0 <= w - u -> 0 <= w + u -> Rabs u <= w).
  { intros u w Hl Hu. apply Rabs_le. lra. }
  assert (H : forall t, 0 <= t < T -> forall x, In x faces -> 0 <= f x t).
  { apply (barrier faces f f').
    - intros (j, s) Hj. apply Hout in Hj.
      destruct s; [apply evolves_minus | apply evolves_plus]; auto.
    - intros (j, s) Hj. apply Hout in Hj. specialize (H0 j Hj).
      assert (Hl := Rle_abs (e j 0)). assert (Hu := Rle_abs (- e j 0)). rewrite Rabs_Ropp in Hu.
      unfold f; destruct s; simpl; lra.
    - intros u Hu Hall (j, s) Hj Hz. apply Hout in Hj.
      destruct (Hface u Hu) with (k := j) as (Hup & Hlow); [|exact Hj|].
      + intros i Hi. apply Habs; [exact (Hall (i, true) (Hin i true Hi)) | exact (Hall (i, false) (Hin i false Hi))].
      + unfold f in Hz; unfold f'; destruct s; simpl in *.
        * assert (g j u < b' j u) by (apply Hup; lra). lra.
        * assert (- b' j u < g j u) by (apply Hlow; lra). lra. }
  apply Habs; [exact (H t Ht (k, true) (Hin k true Hk)) | exact (H t Ht (k, false) (Hin k false Hk))].
Qed.

(* The same for functions numbered 0 .. n-1. *)
Lemma never_leaves n (e g b b' : nat -> R -> R) :
  (forall k, (k < n)%nat -> evolves (e k) (g k)) ->
  (forall k, (k < n)%nat -> evolves (b k) (b' k)) ->
  (forall k, (k < n)%nat -> Rabs (e k 0) <= b k 0) ->
  (forall t, 0 <= t < T -> (forall j, (j < n)%nat -> Rabs (e j t) <= b j t) ->
     forall k, (k < n)%nat ->
       (e k t = b k t -> g k t < b' k t) /\ (e k t = - b k t -> - b' k t < g k t)) ->
  forall t, 0 <= t < T -> forall k, (k < n)%nat -> Rabs (e k t) <= b k t.
Proof.
  assert (Hseq : forall k, In k (seq 0 n) <-> (k < n)%nat) by (intros k; rewrite in_seq; lia).
  intros He Hb H0 Hface t Ht k Hk.
  apply (never_leaves_list (seq 0 n) e g b b'); try exact Ht; try (apply Hseq; exact Hk).
  - intros j Hj. apply He, Hseq, Hj.
  - intros j Hj. apply Hb, Hseq, Hj.
  - intros j Hj. apply H0, Hseq, Hj.
  - intros u Hu Hall j Hj. apply Hface; [exact Hu | | apply Hseq, Hj].
    intros i Hi. apply Hall, Hseq, Hi.
Qed.

(* The same for functions numbered by agent i < n and component c < m. *)
Lemma never_leaves_agents n m (e g b b' : nat -> nat -> R -> R) :
  (forall i c, (i < n)%nat -> (c < m)%nat -> evolves (e i c) (g i c)) ->
  (forall i c, (i < n)%nat -> (c < m)%nat -> evolves (b i c) (b' i c)) ->
  (forall i c, (i < n)%nat -> (c < m)%nat -> Rabs (e i c 0) <= b i c 0) ->
  (forall t, 0 <= t < T -> (forall j d, (j < n)%nat -> (d < m)%nat -> Rabs (e j d t) <= b j d t) ->
     forall i c, (i < n)%nat -> (c < m)%nat ->
       (e i c t = b i c t -> g i c t < b' i c t) /\ (e i c t = - b i c t -> - b' i c t < g i c t)) ->
  forall t, 0 <= t < T -> forall i c, (i < n)%nat -> (c < m)%nat -> Rabs (e i c t) <= b i c t.
Proof.
  assert (Hp : forall i c, In (i, c) (list_prod (seq 0 n) (seq 0 m)) <-> (i < n)%nat /\ (c < m)%nat).
  { intros i c. rewrite in_prod_iff, !in_seq. lia. }
  intros He Hb H0 Hface t Ht i c Hi Hc.
  set (two := fun (h : nat -> nat -> R -> R) (x : nat * nat) => h (fst x) (snd x)).
  apply (never_leaves_list (list_prod (seq 0 n) (seq 0 m)) (two e) (two g) (two b) (two b'))
    with (k := (i, c)); try exact Ht; try (apply Hp; split; assumption).
  - intros (j, d) Hj. apply Hp in Hj. apply He; apply Hj.
  - intros (j, d) Hj. apply Hp in Hj. apply Hb; apply Hj.
  - intros (j, d) Hj. apply Hp in Hj. apply H0; apply Hj.
  - intros u Hu Hall (j, d) Hj. apply Hp in Hj. apply Hface; try apply Hj; [exact Hu|].
    intros j' d' Hj' Hd'. apply (Hall (j', d')), Hp. split; assumption.
Qed.

(* ---- Decay ---- *)

(* A bound that holds with every slack eps * c holds. *)
Lemma no_slack a b c : (forall eps, 0 < eps <= 1 -> a <= b + eps * c) -> a <= b.
Proof.
  intros H. apply le_epsilon. intros eps Heps.
  set (d := eps / (Rabs c + eps)).
  assert (Hc := Rabs_pos c).
  assert (Hd : d * (Rabs c + eps) = eps) by (unfold d; field; lra).
  assert (Hd0 : 0 < d) by (unfold d; apply Rdiv_lt_0_compat; lra).
  assert (Hd1 : d <= 1).
  { unfold d. apply (Rmult_le_reg_r (Rabs c + eps)); [lra|]. unfold Rdiv.
    rewrite Rmult_assoc, Rinv_l by lra. lra. }
  assert (Ha : d * c <= d * Rabs c) by (apply Rmult_le_compat_l; [lra | apply Rle_abs]).
  assert (Hd2 : d * (Rabs c + eps) = d * Rabs c + d * eps) by ring.
  assert (0 <= d * eps) by (apply Rmult_le_pos; lra).
  specialize (H d (conj Hd0 Hd1)). lra.
Qed.

(* What never has a negative slope never falls below its start. *)
Lemma never_falls f f' :
  evolves f f' -> (forall t, 0 <= t < T -> 0 <= f' t) -> forall t, 0 <= t < T -> f 0 <= f t.
Proof.
  intros Hf Hpos t Ht. apply (no_slack _ _ t). intros eps Heps.
  assert (H : forall t, 0 <= t < T -> forall k, In k [tt] -> 0 <= f t + eps * t - f 0).
  { apply (barrier [tt] (fun _ t => f t + eps * t - f 0) (fun _ t => f' t + eps * 1 - 0)).
    - intros k _. apply evolves_minus; [|apply evolves_const].
      apply evolves_plus; [exact Hf | apply evolves_scale, evolves_time].
    - intros k _. lra.
    - intros u Hu _ k _ _. specialize (Hpos u Hu). lra. }
  specialize (H t Ht tt (or_introl eq_refl)). lra.
Qed.

End Until.

(* The two facts about exp that are needed, for nonnegative arguments. *)
Lemma exp_rises x : 0 <= x -> 1 <= exp x.
Proof.
  intros Hx. rewrite <- exp_0.
  replace 0 with (1 * 0) at 1 by ring. replace x with (1 * x) by ring.
  refine (never_falls (fun t => exp (1 * t)) _ (evolves_exp (T := x + 1) 1) _ x _); [|lra].
  intros t _. assert (H := exp_pos (1 * t)). lra.
Qed.

Lemma exp_le x y : x <= y -> exp x <= exp y.
Proof.
  intros H. replace y with (x + (y - x)) by ring. rewrite exp_plus.
  assert (1 <= exp (y - x)) by (apply exp_rises; lra).
  assert (Hx := exp_pos x).
  rewrite <- (Rmult_1_r (exp x)) at 1. apply Rmult_le_compat_l; lra.
Qed.

Lemma exp_tangent x : 0 <= x -> 1 - x <= exp (- x).
Proof.
  intros Hx.
  assert (H : exp (- (1 * 0)) + 0 <= exp (- (1 * x)) + x).
  { refine (never_falls (fun t => exp (- (1 * t)) + t) _
      (evolves_plus (T := x + 1) _ _ _ _ (evolves_exp_decay 1) evolves_time) _ x _); [|lra].
    intros t Ht. assert (exp (- (1 * t)) <= exp 0) by (apply exp_le; lra).
    rewrite exp_0 in *. lra. }
  replace (- (1 * 0)) with 0 in H by ring. replace (- (1 * x)) with (- x) in H by ring.
  rewrite exp_0 in H. lra.
Qed.

Section Until2.
Context {T : R}.
Local Notation evolves := (@evolves T).

(* V' <= - c V: V decays at the rate c. *)
Lemma decays V V' c :
  evolves V V' -> (forall t, 0 <= t < T -> V' t <= - c * V t) ->
  forall t, 0 <= t < T -> V t <= V 0 * exp (- (c * t)).
Proof.
  intros HV Hc t Ht.
  assert (H : - (V 0 * exp (c * 0)) <= - (V t * exp (c * t))).
  { refine (never_falls (fun t => - (V t * exp (c * t))) _
      (evolves_opp _ _ (evolves_mult _ _ _ _ HV (evolves_exp c))) _ t Ht).
    intros u Hu. specialize (Hc u Hu). assert (He := exp_pos (c * u)).
    replace (- (V' u * exp (c * u) + V u * (c * exp (c * u))))
      with ((- c * V u - V' u) * exp (c * u)) by ring.
    apply Rmult_le_pos; lra. }
  rewrite Rmult_0_r, exp_0 in H.
  assert (He := exp_pos (- (c * t))).
  assert (Hinv : exp (c * t) * exp (- (c * t)) = 1).
  { rewrite <- exp_plus, Rplus_opp_r. apply exp_0. }
  replace (V t) with (V t * exp (c * t) * exp (- (c * t))) by (rewrite Rmult_assoc, Hinv; ring).
  apply Rmult_le_compat_r; lra.
Qed.

(* ---- Quadratic forms along linear motions ---- *)

(* a' P a *)
Definition form (q : nat) (P : nat -> nat -> R) (a : nat -> R) : R :=
  sum q (fun k => sum q (fun j => P k j * a k * a j)).

(* F a *)
Definition matvec (q : nat) (F : nat -> nat -> R) (a : nat -> R) (k : nat) : R := sum q (fun j => F k j * a j).

(* The derivative of a' P a along a' = F a. *)
Definition form_slope (q : nat) (P F : nat -> nat -> R) (a : nat -> R) : R :=
  sum q (fun k => sum q (fun j => P k j * (matvec q F a k * a j + a k * matvec q F a j))).

(* A quadratic form of a linear motion has the derivative it should have. *)
Lemma form_evolves q (F P : nat -> nat -> R) (y : nat -> R -> R) :
  (forall k, (k < q)%nat -> evolves (y k) (fun t => sum q (fun j => F k j * y j t))) ->
  evolves (fun t => form q P (fun k => y k t)) (fun t => form_slope q P F (fun k => y k t)).
Proof.
  intros H. unfold form, form_slope, matvec.
  apply (evolves_sum q (fun k t => sum q (fun j => P k j * y k t * y j t))
    (fun k t => sum q (fun j => P k j *
       (sum q (fun h => F k h * y h t) * y j t + y k t * sum q (fun h => F j h * y h t))))).
  intros k Hk.
  apply (evolves_sum q (fun j t => P k j * y k t * y j t)
    (fun j t => P k j *
       (sum q (fun h => F k h * y h t) * y j t + y k t * sum q (fun h => F j h * y h t)))).
  intros j Hj.
  eapply evolves_eq; [exact (evolves_scale (P k j) _ _ (evolves_mult _ _ _ _ (H k Hk) (H j Hj))) | |];
    intros; simpl; ring.
Qed.

(* The Lyapunov inequality F'P + PF <= -2 beta P makes the form decay at the rate 2 beta. *)
Lemma quadratic_decays q (F P : nat -> nat -> R) beta (y : nat -> R -> R) :
  (forall k, (k < q)%nat -> evolves (y k) (fun t => sum q (fun j => F k j * y j t))) ->
  (forall a, form_slope q P F a <= - 2 * beta * form q P a) ->
  forall t, 0 <= t < T -> form q P (fun k => y k t) <= form q P (fun k => y k 0) * exp (- (2 * beta * t)).
Proof.
  intros Hy HP t Ht.
  refine (decays (fun t => form q P (fun k => y k t)) _ (2 * beta) (form_evolves q F P y Hy) _ t Ht).
  intros u _. specialize (HP (fun k => y k u)). lra.
Qed.

End Until2.
